"""Pydantic models of the API's responses. They only describe in OpenAPI what `content` writes and build nothing."""

from __future__ import annotations

from dataclasses import fields
from types import GenericAlias
from typing import Any, Literal, get_type_hints

from pydantic import Field, create_model

from drivecomm.line import ResultQuality
from drivecomm.protocol import DriveStatus, LinkLoss, Quality, Reading, Stop
from drivecomm.server import (
    DriftKind,
    Event,
    LineSnapshot,
    NotComparable,
    RememberedFault,
    SetChange,
    StandingStop,
)


def _model(_name: str, _about: str = "", /, **hints: Any) -> Any:
    """Return a pydantic model in which every field without a default is required."""
    fields: Any = {name: hint if isinstance(hint, tuple) else (hint, ...) for name, hint in hints.items()}
    return create_model(_name, __doc__=_about or None, **fields)


def _plain(owner: type, **more: Any) -> Any:
    """Return the model of a dataclass in the form that `plain` writes: exact decimals become numbers."""
    # Names that a module imports for type checkers only.
    hints = get_type_hints(owner, localns={"Decimal": float, "Stop": Stop, "Value": int | float | str})
    return _model(owner.__name__, **{field.name: hints[field.name] for field in fields(owner)} | more)


def _many(model: Any) -> Any:
    return GenericAlias(list, (model,))


_ABSENT: Any = Field(default_factory=str)
"""Default of an optional field that keeps the default out of the schema."""

_Number, _Text = float | None, str | None
_Outcome = Literal["done", "refused", "failed", "open"]
_Policy: Any = LinkLoss
_DriftKind: Any = DriftKind
_LEASE = {"drive": str, "holder": str, "door": str, "until_s": float, "yours": bool}

Error = _model("Error", "kind: of the tree of errors that Python callers get.", kind=str, text=str, exit_code=int)
ANSWER = {"id": str, "outcome": _Outcome, "result": Any, "error": Error | None}
Problem = _model(
    "Problem", "RFC 9457. id, outcome, result: of a command that was not done; failed: the drive refused, open: it was "
    "sent, and whether the drive acted is not known.",
    title=str, status=int, detail=str, error=Error, id=(str, _ABSENT), outcome=(_Outcome, _ABSENT),
    result=(Any, _ABSENT),
)  # fmt: skip
_Scalar = int | float | str
ReadingAnswer = _plain(Reading, value=_Scalar, quality=Quality)
Value = _model(
    "Value", "The latest of one quantity. source_s: when the reply with it had arrived. machine_value: of a frequency, "
    "the speed of the drive's machine, if the plant file gives its unit.",
    drive=str, name=str, quality=ResultQuality, cause=str, time_s=float, source_s=_Number, age_s=_Number,
    reading=ReadingAnswer | None, machine_value=(float, _ABSENT), machine_unit=(str, _ABSENT),
)  # fmt: skip
Values: Any = _many(Value)
EventAnswer = _plain(Event)
Events: Any = _many(EventAnswer)
You = _model("You", name=str, role=Literal["nobody", "view", "operate", "commission"], door=str)
Plant: Any = _model(
    "Plant", "session: a random word of this run of the server.",
    name=str, file=str, session=str, version=str, started_s=float, time_s=float, you=You, drives=list[str],
    lines=_many(_plain(LineSnapshot)), alarms=int,
)  # fmt: skip
Lease = _model("Lease", **_LEASE)
Leases: Any = _many(Lease)
OwnLease = _model("OwnLease", **_LEASE, key=str)
EndedLease = _model("EndedLease", drive=str)
Drive: Any = _model(
    "Drive", "may: the verbs that you may use. late: its line had no time to ask for its status, which may have "
    "changed since. policies: with which link-loss policies it can be started. monitoring_only: its model has no "
    "orders, so it can only be read. fault_log: the drive's own fault log when last read, the "
    "newest first. kept: the link-loss policy under which the server keeps the motor running. standing_stop: the stop "
    "that is retried until the drive confirms it, or that a door demands; null without one. drift: whether it is set "
    "as approved, and how many parameters differ; null if not compared. machine_unit: what its machine "
    "counts, empty if the plant file does not give it; actual_machine: the actual frequency of the status in it.",
    name=str, drive=str, line=str, title=str, groups=list[str], model=str, armed=bool, read_only_reason=str,
    link_loss=_model("LinkLossPolicy", "What the plant file says.", policy=_Policy, watchdog_s=float) | None,
    policies=_many(_Policy), monitoring_only=bool, fault_log=_many(_plain(RememberedFault)), may=list[str],
    reachability=Literal["asking", "answers", "silent"], state=_Text, status=_plain(DriveStatus) | None,
    machine_unit=str, actual_machine=_Number, fault=str,
    late=bool, error=str, answered_s=_Number, age_s=_Number, lease=Lease | None, kept=str,
    standing_stop=_plain(StandingStop, text=str) | None,
    drift=_model("DriftInShort", state=_DriftKind, changed=int | None, since_s=_Number, compared_s=_Number),
    counters=dict[str, int], reply_s=float, values=Values,
)  # fmt: skip
Drives: Any = _many(Drive)
Drift: Any = _model(
    "Drift", "What differs in a drive from its baseline, as its last backup showed it. not comparable: nothing is "
    "known to differ, but not all could be compared. changed: how many parameters differ; null if not compared. "
    "since_s: of a change, the first backup with the value of now; of the drive, the earliest of those. cause: "
    "why there is no comparison. replaced: evidence that it is another drive. restore: the command that gives it "
    "the approved set. untold: what it told of itself when it was approved, and does not tell now. equal: how many "
    "parameters are as approved. compared_s: when the drive was read.",
    drive=str, state=_DriftKind, text=str, changed=int | None, since_s=_Number, cause=str,
    changes=_many(_plain(SetChange)), replaced=str, replaced_since_s=_Number, restore=str,
    not_comparable=_many(_plain(NotComparable)), untold=list[str], equal=int, approved_by=str, approved_s=_Number,
    compared_s=_Number,
)  # fmt: skip
Answer = _model("Answer", "Outcome of a command that was carried out.", **ANSWER)
Stops = _many(_model(
    "Stopped", "drive: PROTOCOL:* for a broadcast, which no drive confirms: its outcome is open, without an error.",
    line=str, drive=str, **ANSWER, how=str,
))  # fmt: skip
_Point = tuple[float, _Scalar | None, ResultQuality]
Points: Any = _model("Points", "Time, value and quality of each.", points=list[_Point])
Login = _model("Login", token=str, until_s=float)
Alarm = dict[str, Any]
Alarms = list[Alarm]
