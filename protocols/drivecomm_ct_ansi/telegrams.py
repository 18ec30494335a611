"""The telegrams of Control Techniques' dialect of ANSI X3.28 (UD70 User Guide, issue 70nu2: UD).

    read     EOT G G U U M M P P ENQ                 write    EOT G G U U STX M M P P data ETX BCC
    replies  STX M M P P data ETX BCC                replies  ACK or NAK, which name nothing
             EOT   no such parameter                 rewrite  STX M M P P data ETX BCC, to the drive addressed last
    short    NAK the same parameter again, ACK the next one, BS the one before; answered as a read

(UD p. 6-7 to 6-10, Unidrive SP Advanced User Guide issue 10 p. 402: SP, Mentor MP p. 208, 209: MP.) UD p. 6-8 prints
STX as the first character of a read; it is EOT (p. 6-7). BCC is the exclusive-or of everything after STX up to ETX, and
20H more if that is below 20H (UD p. 6-11); the example on p. 6-10 prints it without these 20H.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

from drivecomm.protocol import schema
from drivecomm.protocol.schema import Form, Leaf, constant

MOST = 12
"""Maximum number of characters in a value (SP p. 402)."""
_STX, _ETX, _EOT, _ENQ, _ACK, _NAK, _BS = (bytes([each]) for each in (0x02, 0x03, 0x04, 0x05, 0x06, 0x15, 0x08))
_TOLD = re.compile(r"[+\- ]?([0-9]{1,10}(\.[0-9]+)?)|X([0-9A-F]{1,8})")
_SENT = re.compile(r" *[+\-]?([0-9]{1,10}(\.[0-9]+)?)|X([0-9A-F]{1,8})")


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """Request of the master; short commands and a rewrite name no drive.

    data: the value, with its characters as sent. unit: 0 means the whole group, and group 0 with unit 0 all drives (MP
    p. 209).
    """

    kind: str
    group: int | None = None
    unit: int | None = None
    menu: int | None = None
    parameter: int | None = None
    data: str | None = None

    @property
    def address(self) -> int | None:
        """Group and unit, 12 for unit 2 of group 1; None for the drive that was addressed last."""
        return None if self.group is None or self.unit is None else self.group * 10 + self.unit


@dataclass(frozen=True, slots=True, kw_only=True)
class Reply:
    """Reply of a drive, which never names the drive; only a value names its parameter."""

    kind: str
    menu: int | None = None
    parameter: int | None = None
    data: str | None = None


def lifted_xor(covered: bytes) -> bytes:
    """Return the BCC: the exclusive-or, plus 20H if it is below 20H (UD p. 6-11)."""
    found = schema.xor_byte(covered)
    return found if found[0] >= 0x20 else bytes([found[0] + 0x20])


def _checked(data: Any, kind: str) -> str:
    """Return a value if its format is right (SP p. 402, UD p. 6-7, 6-8). Raises TelegramError otherwise.

    A value for a drive has at least two characters; in a value from a drive, the sign comes first.
    """
    wanted = _TOLD if kind == "value" else _SENT
    found = wanted.fullmatch(data) if isinstance(data, str) else None
    if found and found[1] and not -(1 << 31) <= int(re.sub("[ .]", "", data)) < 1 << 31:
        found = None
    if not found or len(data) > MOST or (kind != "value" and len(data) < 2):
        raise schema.wrong_field("data", "it is missing" if data is None else f"{data!r} is not a value")
    return str(data)


def _form(message: type[Any], kind: str, *leaves: Any) -> Form[Any]:
    reads: dict[str, Any] = {"kind": lambda: kind}
    has_data = kind in ("value", "write", "rewrite")
    if has_data:
        reads["data"] = lambda text: _checked(text, kind)

    def check(given: Any) -> None:
        if given.kind != kind:
            raise schema.wrong_field("kind", f"{given.kind!r} is not a telegram")
        if kind in ("read", "write") and given.unit and not given.group:
            raise schema.wrong_field("group", "it is 0 only together with the unit, for all drives")
        if kind == "read" and not given.unit:
            raise schema.wrong_field("unit", "drives that are read together answer over each other (MP p. 209)")

    writes = {"text": lambda given: _checked(given.data, kind)} if has_data else {}
    return Form(message, *leaves, reads=reads, writes=writes, check=check, when=lambda given: given.kind == kind)


def _double(name: str) -> Any:
    return name / schema.choice({b"%d%d" % (each, each): each for each in range(10)}, f"{name}, twice")


_HEAD = [constant(_EOT, "EOT"), _double("group"), _double("unit")]
_WHAT = ["menu" / schema.decimal_number(2, meaning="menu"), "parameter" / schema.decimal_number(2, meaning="parameter")]


def _value(start: int) -> tuple[Any, ...]:
    """Return the leaves of a value from STX on.

    start: the first character that the BCC covers.
    """
    text = Leaf(
        schema.until(_ETX, most=MOST), bytes.decode, str.encode, meaning="value", alphabet=bytes(range(32, 127))
    )
    behind = constant(_ETX, "ETX"), schema.Check(1, start, lifted_xor, meaning="BCC")
    return constant(_STX, "STX"), *_WHAT, "text" / text, *behind


TELEGRAMS = schema.Telegrams(
    {
        "Read": _form(Request, "read", *_HEAD, *_WHAT, constant(_ENQ, "ENQ")),
        "Write": _form(Request, "write", *_HEAD, *_value(6)),
        "Rewrite": _form(Request, "rewrite", *_value(1)),
        "Repeat": _form(Request, "repeat", constant(_NAK, "NAK")),
        "Next": _form(Request, "next", constant(_ACK, "ACK")),
        "Previous": _form(Request, "previous", constant(_BS, "BS")),
    },
    {
        "Value": _form(Reply, "value", *_value(1)),
        "Unknown parameter": _form(Reply, "unknown", constant(_EOT, "EOT")),
        "ACK": _form(Reply, "ack", constant(_ACK, "ACK")),
        "NAK": _form(Reply, "nak", constant(_NAK, "NAK")),
    },
    alike="ct-ansi",
)
"""Codec of the telegrams."""
