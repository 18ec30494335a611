"""The telegrams of the Fuji general-purpose inverter protocol.

Page 9-15 of the VXSM150-1 manual for the standard frame; FVR-E11S manual 9-16 to 9-20, FRENIC-VG option manual 5-19 to
5-28 and HVAC/AQUA RS-485 manual 4-2 to 4-11 for the others.

    standard request   SOH s s ENQ  c  t n n SP   d d d d  ETX k k    c = R W A E
    standard reply     SOH s s ACK  c  t n n SP/- d d d d  ETX k k
    standard refusal   SOH s s NAK  c  t n n SP   _ _ x x  ETX k k    x = error code, hexadecimal
    select request     SOH s s ENQ  c  d d d d ETX k k                c = a-f m
    select reply       SOH s s A/N  c  ETX k k
    poll request       SOH s s ENQ  c  ETX k k                        c = g-k
    poll reply         SOH s s A/N  c  d d d d ETX k k

ss is the station, 01 to 31, or 99 for all. t is the function type, nn its number. dddd are four hexadecimal digits. kk
is the sum of everything after SOH up to and including ETX, its low eight bits in hexadecimal. Direction and byte 4
decide the length. Only the first byte of a frame is 01H, so a receiver starts again whenever it sees one.

Faults to expect: a wrong sum; an echo of the request, which has ENQ where a reply has ACK or NAK; a NAK with code 74 or
75, which need not repeat the refused command; an ACK of a write, whose data field means nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from drivecomm.errors import TelegramError
from drivecomm.protocol import Intent, difference
from drivecomm.protocol.schema import (
    Check,
    Form,
    Leaf,
    Telegrams,
    choice,
    constant,
    deciding,
    decimal_number,
    filler,
    hex_number,
    hex_sum,
    message_of,
    one_of,
    unsure,
)
from drivecomm_fuji.generations import FUNCTION_ERROR, FUNCTIONS, WITHOUT_ECHO

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from drivecomm.protocol import Direction, Message

SOH, ETX, ENQ, ACK, NAK = b"\x01", b"\x03", b"\x05", b"\x06", b"\x15"

STATIONS = range(1, 32)
BROADCAST = 99
_ANYBODY = frozenset([*STATIONS, BROADCAST])

FrameKind: TypeAlias = Literal["request", "ack", "nak"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Standard:
    """A frame of 16 bytes.

    data: the four hexadecimal digits, unsigned. negative: byte 8 is "-", and data is a magnitude. E has no function. R
    requests, and telegrams whose data field means nothing, have no data. Only a NAK has an error_code.
    """

    frame: Literal["standard"] = "standard"
    kind: FrameKind
    address: int
    command: str
    function: str | None = None
    data: int | None = None
    negative: bool = False
    error_code: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Select:
    """A short frame that writes: a request of 12 bytes, and a reply of 8 bytes without data."""

    frame: Literal["select"] = "select"
    kind: FrameKind
    address: int
    command: str
    data: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Poll:
    """A short frame that reads: a request of 8 bytes, and a reply of 12 bytes."""

    frame: Literal["poll"] = "poll"
    kind: FrameKind
    address: int
    command: str
    data: int | None = None


Frame: TypeAlias = Standard | Select | Poll

_FRAMES: dict[type[Any], str] = {Standard: "standard", Select: "select", Poll: "poll"}
_MESSAGES: dict[str, type[Any]] = {
    **dict.fromkeys("RWAE", Standard),
    **dict.fromkeys("abcdefm", Select),
    **dict.fromkeys("ghijk", Poll),
}


def _never_written(text: object) -> bytes:
    raise ValueError(f"{text!r} is not a command, and a NAK of such a command is only read")


_CONTROL = {"request": ENQ, "ack": ACK, "nak": NAK}
_NAMES = {"request": "ENQ", "ack": "ACK", "nak": "NAK"}


def head(kinds: Sequence[str], commands: str) -> tuple[Any, ...]:
    """Return the leaves with which every frame of these kinds and commands begins."""
    who = (_ANYBODY, "station 01..31, 99 for all") if "request" in kinds else (STATIONS, "station 01..31")
    controls = choice({_CONTROL[kind]: kind for kind in kinds}, " or ".join(_NAMES[kind] for kind in kinds))
    letters = choice({letter.encode(): letter for letter in commands}, "command " + " ".join(commands))
    return (
        constant(SOH, "SOH"),
        "address" / decimal_number(2, *who),
        "kind" / deciding(controls),
        "command" / deciding(letters),
    )


_FUNCTION_LEAF = one_of(sorted(FUNCTIONS), str.encode, "function type, tens and units digit of its number")
_FUNCTION, _NO_FUNCTION = "function" / _FUNCTION_LEAF, filler(b"   ", "spaces")
SPACE = "negative" / choice({b" ": False}, meaning="space")
_SIGN = "negative" / choice({b" ": False, b"-": True}, meaning='space, or "-" before a magnitude')
_DATA = "data" / hex_number(4, "data, four hexadecimal digits")
_UNSURE_DATA = "data" / unsure(hex_number(4), "means nothing, shown when it is a number")
_CODE = "error_code" / unsure(hex_number(2), "error code, hexadecimal")
TAIL = (constant(ETX, "ETX"), Check(2, 1, hex_sum, meaning="sum from the station to ETX, hexadecimal"))


def _echoed(function: str | None, error_code: int | None) -> str | None:
    """Return the function of a standard NAK; NAKs with some codes need not repeat it, or repeat an unknown one."""
    if function is None and error_code not in _UNECHOED:
        raise ValueError("the refused function does not exist")
    return function


def _to_echo(message: Standard) -> None:
    if message.function is None and message.error_code not in _UNECHOED:
        raise TelegramError(
            "field", f"a NAK with code {message.error_code} repeats the refused function", field="function"
        )


_UNECHOED = WITHOUT_ECHO | {FUNCTION_ERROR}

_ROWS: tuple[tuple[str, Sequence[str], str, tuple[Any, ...]], ...] = (
    ("Standard request, R", ["request"], "R", (_FUNCTION, SPACE, filler(b"0000", "not looked at, zeros"))),
    ("Standard request, W and A", ["request"], "WA", (_FUNCTION, SPACE, _DATA)),
    ("Standard request, E", ["request"], "E", (_NO_FUNCTION, SPACE, filler(b"    ", "spaces"))),
    ("Standard reply, R", ["ack"], "R", (_FUNCTION, _SIGN, _DATA)),
    ("Standard reply, W and A", ["ack"], "WA", (_FUNCTION, _SIGN, _UNSURE_DATA)),
    ("Standard reply, E", ["ack"], "E", (_NO_FUNCTION, _SIGN, filler(b"    ", "not looked at, spaces"))),
    ("Optional selecting, request", ["request"], "abcdefm", (_DATA,)),
    ("Optional selecting, reply", ["ack", "nak"], "abcdefm", ()),
    ("Optional polling, request", ["request"], "ghijk", ()),
    ("Optional polling, reply", ["ack"], "ghijk", (_DATA,)),
    ("Optional polling, NAK", ["nak"], "ghijk", (filler(b"0000", "not looked at"),)),
)
"""All telegrams but standard refusals: title, kinds, commands and the leaves between head and tail."""
_FORMS = {
    title: Form(_MESSAGES[commands[0]], *head(kinds, commands), *leaves, *TAIL)
    for title, kinds, commands, leaves in _ROWS
}
LENGTHS: dict[tuple[Direction, int], int] = {
    ("request" if kinds == ["request"] else "reply", ord(letter)): _FORMS[title].size
    for title, kinds, commands, _ in _ROWS
    for letter in commands
}
"""Lengths of telegrams by direction and command; a NAK is as long as an ACK."""


@cache
def telegrams(space: str = "  ") -> Telegrams:
    """Return the codec.

    space: the ignored characters before the error code of a standard NAK.
    """
    end = (_SIGN, filler(space.encode(), "not looked at"), _CODE, *TAIL)
    refused = "function" / unsure(_FUNCTION_LEAF)
    refusals = {
        "Standard NAK": Form(
            Standard, *head(["nak"], "RWA"), refused, *end, reads={"function": _echoed}, check=_to_echo
        ),
        "Standard NAK, E": Form(Standard, *head(["nak"], "E"), _NO_FUNCTION, *end),
    }
    return Telegrams(
        requests={title: form for title, form in _FORMS.items() if "request" in title},
        replies={**{title: form for title, form in _FORMS.items() if "request" not in title}, **refusals},
    )


COMMAND_REFUSED = Form(
    Standard,
    *head(["nak"], "R")[:3],
    "command" / Leaf(1, lambda found: found.decode("latin-1"), _never_written, meaning="the refused command"),
    filler(b"   ", "not looked at"),
    _SIGN,
    filler(b"  ", "not looked at"),
    _CODE,
    *TAIL,
)
"""Form of a NAK that refuses an unlisted command."""


def titled_forms() -> dict[str, Form[Any]]:
    """Return the forms of all telegrams by their human-readable titles."""
    return {**telegrams().forms, "NAK of a command that does not exist": COMMAND_REFUSED}


def message_from(given: Mapping[str, Any], direction: Direction) -> Message:
    """Build a message from fields as test vectors name them; `frame` may be omitted, since the command decides it."""
    kinds = ("request",) if direction == "request" else ("ack", "nak")
    if given.get("kind") not in kinds:
        raise TelegramError("field", f"the kind of a {direction} is one of {', '.join(kinds)}", field="kind")
    command = given.get("command")
    message = _MESSAGES.get(command) if isinstance(command, str) else None
    if message is None:
        raise TelegramError("field", f"the command is one of {', '.join(_MESSAGES)}, not {command!r}", field="command")
    frame = _FRAMES[message]
    if given.get("frame", frame) != frame:
        raise TelegramError("field", f"{command!r} belongs to a {frame} frame", field="frame")
    implied = {"data": 0} if command == "m" and direction == "request" else {}
    made: Message = message_of(message, {**implied, **given}, f"a {frame} frame")
    return made


_ALARM_RESET = {Standard: "E", Select: "m"}


def intent(request: Message) -> Intent:
    """Return the purpose of a request, by its frame and command; only the alarm reset has no function."""
    if isinstance(request, Poll) or (isinstance(request, Standard) and request.command == "R"):
        return Intent(access="read")
    if isinstance(request, Standard | Select) and request.command != _ALARM_RESET[type(request)]:
        return Intent(access="write")
    return Intent(commands=True)


def mismatch(request: Message, reply: Message) -> str:
    """Return the first field in which a sound reply does not belong to a request; empty if it belongs.

    A NAK with code 74 or 75 is matched by its station alone, and also counts as the reply to an optional frame.
    """
    if not isinstance(request, Frame) or request.kind != "request":
        return "kind"
    if not isinstance(reply, Frame) or reply.kind == "request":
        return "kind"
    if reply.address != request.address:
        return "address"
    if isinstance(reply, Standard) and reply.kind == "nak":
        listed = reply.command in _MESSAGES
        if reply.error_code in WITHOUT_ECHO or (not listed and reply.error_code is None):
            return ""
    return difference(request, reply, "frame", "command", *(["function"] if isinstance(request, Standard) else []))
