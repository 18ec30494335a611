"""Exchange vectors: a conversation with one drive, as calls of the master and steps on the wire.

[[exchange]]
id = "read-481"
source = "Agile VABus manual p. 41"
address = 1
calls = [{ call = "read", arguments = { parameter = "481" } }]
steps = [{ send = "04 41 30 30 34 38 31 05" }, { reply = "41 02 …" }, { send = "04" }]
result = { raw = 1000 }
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from drivecomm import errors
from drivecomm.testing.entry import VectorEntry
from drivecomm.tomlfile import CHOICE, SECONDS, TABLE, TEXT, WHOLE, Kind

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from drivecomm.tomlfile import TomlTable

Action: TypeAlias = Literal["send", "reply", "silence", "garbage", "pause_s"]

_CLASSES = ((name, kind) for name, kind in vars(errors).items() if isinstance(kind, type))
ERROR_NAMES = tuple(sorted(name for name, kind in _CLASSES if issubclass(kind, errors.DriveCommError)))
"""Names of all classes of the error tree."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WireStep:
    """The next event on the wire.

    action: kind of event. data: the bytes of a send, reply or garbage. seconds: for a reply and garbage the delay
    between the end of the previous step and their start; for a pause the time for which the master must be silent; for
    silence the reply timeout, None for the drive's own.
    """

    action: Action
    data: bytes = b""
    seconds: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Expected:
    """Expected outcome of a call.

    result: fields that the result must contain; an empty mapping if the result must be None; None if the result is not
    checked. error: class name of the error that must be raised instead, empty for a call that must succeed. error_text:
    a part of the error's text.
    """

    result: Mapping[str, Any] | None = None
    error: str = ""
    error_text: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class VectorCall:
    """One call of a verb of the drive: its name, its arguments by name, and its expected outcome."""

    call: str
    arguments: Mapping[str, Any] = field(default_factory=dict)
    expected: Expected = field(default_factory=Expected)


@dataclass(frozen=True, slots=True, kw_only=True)
class ExchangeVector:
    """A conversation with one drive, or with all drives at the broadcast address.

    model: name of a model of the protocol's package, or empty. options: further arguments of `Bus.drive`. watched_s:
    known timeout of the drive's watchdog in seconds, None if no watchdog is known to be on. steps: all events on the
    wire, for all calls. printed: every telegram is printed in the source.
    """

    id: str
    source: str
    address: int
    calls: tuple[VectorCall, ...]
    steps: tuple[WireStep, ...]
    printed: bool = False
    model: str = ""
    options: Mapping[str, Any] = field(default_factory=dict)
    watched_s: float | None = None
    note: str = ""


_EXPECTED = {"result": TABLE, "error": TEXT, "error_text": TEXT}
_CALL = {"call": TEXT, "arguments": TABLE, **_EXPECTED}
_EXCHANGE = {
    **dict.fromkeys(("id", "source", "model", "note"), TEXT),
    "printed": CHOICE,
    "address": WHOLE,
    "options": TABLE,
    "watched_s": SECONDS,
    "calls": Kind((list,), 'a list of tables, such as [{ call = "status" }]'),
    "steps": Kind((list,), 'a list of tables, such as [{ send = "04" }]'),
    **_EXPECTED,
}
_STEPS: dict[Action, dict[str, Kind]] = {
    "send": {"send": TEXT},
    "reply": {"reply": TEXT, "after_s": SECONDS},
    "silence": {"silence": CHOICE, "at_least_s": SECONDS},
    "garbage": {"garbage": TEXT, "after_s": SECONDS},
    "pause_s": {"pause_s": SECONDS},
}
ACTIONS = tuple(_STEPS)


def read_exchange(table: TomlTable) -> ExchangeVector:
    """Return an exchange vector from its table. Raises FileFormatError."""
    entry = VectorEntry(table, _EXCHANGE, "id", "source", "address", "calls", "steps")
    given, steps = entry.given, _steps(table.tables("steps"))
    calls = [_call(each) for each in table.tables("calls")]
    if not calls:
        raise entry.error("calls is empty", "calls")
    # The outcome of the whole vector belongs beside the calls, not inside the last one.
    if calls[-1].expected != Expected():
        raise entry.error("the last call's result and error stand beside calls, not in it", "calls")
    calls[-1] = replace(calls[-1], expected=_expected(entry))
    own = {key: value for key, value in given.items() if key not in _EXPECTED}
    return ExchangeVector(**{**own, "calls": tuple(calls), "steps": steps})


def _call(table: TomlTable) -> VectorCall:
    entry = VectorEntry(table, _CALL, "call")
    return VectorCall(call=entry.given["call"], arguments=entry.given.get("arguments", {}), expected=_expected(entry))


def _expected(entry: VectorEntry) -> Expected:
    given = entry.given
    entry.only("an exchange that ends with an error", "result", allowed="error" not in given)
    entry.only("an exchange without error", "error_text", allowed="error" in given)
    if "error" in given:
        entry.choice("error", ERROR_NAMES)
    return Expected(**{key: given[key] for key in _EXPECTED if key in given})


def _steps(tables: Sequence[TomlTable]) -> tuple[WireStep, ...]:
    # A conversation may have no steps: a call that must be refused before anything is sent.
    steps = tuple(map(_step, tables))
    for step, table, following in zip(steps, tables, [*steps[1:], None][: len(steps)], strict=True):
        if step is steps[0] and step.action in ("reply", "silence"):
            raise table.error(f"{step.action} comes after a send")
        if step.action == "pause_s" and (following is None or following.action != "send"):
            raise table.error("after a pause comes a send")
    return steps


def _step(table: TomlTable) -> WireStep:
    found = [action for action in ACTIONS if action in table.content]
    if len(found) != 1:
        raise table.error(f"has exactly one of {', '.join(ACTIONS)}")
    action = found[0]
    entry = VectorEntry(table, _STEPS[action])
    if action == "pause_s":
        return WireStep(action=action, seconds=entry.seconds("pause_s"))
    if action == "silence":
        if not entry.given["silence"]:
            raise entry.error("silence is true or absent")
        return WireStep(action=action, seconds=entry.seconds("at_least_s"))
    return WireStep(action=action, data=entry.data(action), seconds=entry.seconds("after_s"))
