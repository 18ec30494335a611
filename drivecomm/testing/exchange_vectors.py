"""Exchange vectors: a conversation with one drive, as calls on this side and steps on the wire.

[[exchange]]
id = "read-481"
source = "Agile VABus manual p. 41"
address = 1
calls = [{ call = "read", arguments = { parameter = "481" } }]
steps = [{ send = "04 41 30 30 34 38 31 05" }, { reply = "41 02 …" }, { send = "04" }]
result = { raw = 1000 }
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from drivecomm import errors

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.testing.entry import Entry

Deed: TypeAlias = Literal["send", "reply", "silence", "garbage", "pause_s"]

DEEDS: tuple[Deed, ...] = ("send", "reply", "silence", "garbage", "pause_s")

ERROR_NAMES = tuple(
    sorted(
        name
        for name, kind in vars(errors).items()
        if isinstance(kind, type) and issubclass(kind, errors.DriveCommError)
    )
)
"""The error tree by name."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """What happens on the wire next.

    deed: who does what. data: the bytes of a send, a reply or garbage. seconds: for a reply and garbage how long after
    the end of the step before they begin; for a pause how long the master must be silent; for silence how long the
    reply time is, None for the drive's own.
    """

    deed: Deed
    data: bytes = b""
    seconds: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Expected:
    """What must come of a call.

    result: the fields that must be in it, an empty mapping for None, None where it is not judged. error: the name of
    the class that must be raised instead, empty for a call that must succeed. error_text: a part of its text.
    """

    result: Mapping[str, Any] | None = None
    error: str = ""
    error_text: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Call:
    """One call of a verb of the drive: its name, its arguments by name, and what must come of it."""

    call: str
    arguments: Mapping[str, Any] = field(default_factory=dict)
    expected: Expected = field(default_factory=Expected)


@dataclass(frozen=True, slots=True, kw_only=True)
class ExchangeVector:
    """A conversation with the drive, or at the broadcast address with all drives.

    model: of the protocol's package, empty for none. options: what `Bus.drive` takes besides. steps: all that happens
    on the wire, over all calls. printed: every telegram stands in the source.
    """

    id: str
    source: str
    address: int
    calls: tuple[Call, ...]
    steps: tuple[Step, ...]
    printed: bool = False
    model: str = ""
    options: Mapping[str, Any] = field(default_factory=dict)
    note: str = ""


def read_exchange(entry: Entry) -> ExchangeVector:
    """Return an exchange vector from its table. Raises FileFormatError."""
    steps = _steps(entry)
    calls = [_call(part) for part in entry.parts("calls", "call")]
    # What the whole is judged by stands beside it and not inside its last call.
    if calls[-1].expected != Expected():
        raise entry.wrong("the last call's result and error stand beside calls, not in it")
    last = Call(call=calls[-1].call, arguments=calls[-1].arguments, expected=_expected(entry))
    vector = ExchangeVector(
        id=entry.id,
        source=entry.text("source"),
        printed=entry.flag("printed", default=False),
        address=entry.whole("address"),
        model=entry.text("model", required=False),
        options=entry.table("options", required=False),
        calls=(*calls[:-1], last),
        steps=steps,
        note=entry.text("note", required=False),
    )
    entry.all_read()
    return vector


def _call(part: Entry) -> Call:
    call = Call(call=part.text("call"), arguments=part.table("arguments", required=False), expected=_expected(part))
    part.all_read()
    return call


def _expected(entry: Entry) -> Expected:
    entry.only("an exchange that ends in an error", "result", allowed="error" not in entry)
    entry.only("an exchange without error", "error_text", allowed="error" in entry)
    return Expected(
        result=entry.table("result") if "result" in entry else None,
        error=entry.choice("error", ERROR_NAMES) if "error" in entry else "",
        error_text=entry.text("error_text", required=False),
    )


def _steps(entry: Entry) -> tuple[Step, ...]:
    # Nothing on the wire is a conversation too: a call that must be refused before anything is sent.
    if "steps" in entry and entry.is_empty_list("steps"):
        return ()
    parts = entry.parts("steps", "step")
    steps = tuple(map(_step, parts))
    for step, part, following in zip(steps, parts, (*steps[1:], None), strict=True):
        if step is steps[0] and step.deed in ("reply", "silence"):
            raise part.wrong(f"{step.deed} comes after a send")
        if step.deed == "pause_s" and (following is None or following.deed != "send"):
            raise part.wrong("after a pause comes a send")
    return steps


def _step(part: Entry) -> Step:
    deed: Deed = part.one_of(DEEDS)  # type: ignore[assignment]
    if deed == "pause_s":
        step = Step(deed=deed, seconds=part.seconds("pause_s"))
    elif deed == "silence":
        if not part.flag("silence"):
            raise part.wrong("silence is true or absent")
        step = Step(deed=deed, seconds=part.seconds("at_least_s"))
    elif deed == "send":
        step = Step(deed=deed, data=part.data("send"))
    else:
        step = Step(deed=deed, data=part.data(deed), seconds=part.seconds("after_s"))
    part.all_read()
    return step
