"""The telegrams of EI Bisynch in ASCII.

Parker HA466357U001 "6513 RS485/RS232 Communications Interface", issue 7: P65.

    enquiry    EOT G G U U C1 C2 ENQ                        replies  STX C1 C2 data ETX BCC, or EOT
    selection  EOT G G U U STX C1 C2 data ETX BCC           replies  ACK or NAK

G and U are group and unit, each sent twice (P65 p. 19). EOT: the mnemonic is unknown, or an error; NAK: not accepted
(P65 p. 25). BCC is the exclusive-or of everything after STX up to ETX (P65 p. 19, 590+ manual p. A-17). A note on P65
p. 19 suggests 20H more below 20H, as relatives of X3.28 have it, so both are accepted unless the option `lift` decides.
After a value a master may send ACK for the next parameter of a list, NAK for the same again, and EOT (P65 p. 25).
drivecomm does not send them. Such characters are not requests here, since each looks like a reply, or like a broken
request.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar

from drivecomm.protocol import schema
from drivecomm.protocol.schema import Form, constant

_STX, _ETX, _EOT, _ENQ, _ACK, _NAK = (bytes([each]) for each in (0x02, 0x03, 0x04, 0x05, 0x06, 0x15))
_VALUE = re.compile(r">[0-9A-F]{1,4}|-?[0-9]{1,5}\.[0-9]{0,4}", re.ASCII)
"""Hexadecimal, or up to five digits, a point, which is never omitted, and up to four more (590+ manual p. A-12)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Enquiry:
    """Read request for a parameter, to a unit 0 to 15 of a group 0 to 9."""

    kind: ClassVar[str] = "enquiry"
    group: int
    unit: int
    mnemonic: str

    @property
    def address(self) -> int:
        """Sixteen times the group, plus the unit."""
        return self.group * 16 + self.unit


@dataclass(frozen=True, slots=True, kw_only=True)
class Selection(Enquiry):
    """Write request for a parameter.

    data: the characters of the value.
    """

    kind: ClassVar[str] = "selection"
    data: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Value:
    """Reply to an enquiry, which names the parameter and no drive."""

    kind: ClassVar[str] = "value"
    mnemonic: str
    data: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """Reply of one character: `ack`, `nak`, or `end`, which is EOT. It names neither parameter nor drive."""

    kind: str


def lifted_xor(covered: bytes) -> bytes:
    """Return the exclusive-or, plus 20H if it is below 20H."""
    found = schema.xor_byte(covered)
    return found if found[0] >= 0x20 else bytes([found[0] + 0x20])


def is_value(data: Any) -> bool:
    """Return whether this is a valid value in a telegram."""
    return isinstance(data, str) and _VALUE.fullmatch(data) is not None


def _checked(data: Any) -> str:
    if not is_value(data):
        raise ValueError(f"{data!r} is not a value, such as >1F or -12.5 or 1500., which has a point")
    return str(data)


def _double(name: str, digits: str) -> Any:
    doubled = {(digit * 2).encode(): number for number, digit in enumerate(digits)}
    return name / schema.deciding(schema.choice(doubled, f"{name}, sent twice"))


@cache
def codec_for(lift: bool | None) -> schema.Telegrams:
    """Return the codec of the telegrams.

    lift: see `EiOptions`.
    """
    rule, also = (lifted_xor, None) if lift else (schema.xor_byte, lifted_xor if lift is None else None)
    head = constant(_EOT, "EOT"), _double("group", "0123456789"), _double("unit", "0123456789ABCDEF")
    mnemonic = "mnemonic" / schema.characters(2, lowest=0x21, meaning="mnemonic")

    def ended(start: int) -> tuple[Any, ...]:
        data = schema.Leaf(
            schema.until(_ETX, most=11),
            lambda found: _checked(found.decode()),
            lambda text: _checked(text).encode(),
            meaning="value",
            alphabet=b"-.>0123456789ABCDEF",
        )
        return (
            *(constant(_STX, "STX"), mnemonic, "data" / data, constant(_ETX, "ETX")),
            schema.Check(1, start, rule, also=also, meaning="BCC: exclusive-or of all behind STX"),
        )

    kinds = {_ACK: "ack", _NAK: "nak", _EOT: "end"}
    return schema.Telegrams(
        {
            "Enquiry": Form(Enquiry, *head, mnemonic, constant(_ENQ, "ENQ")),
            "Selection": Form(Selection, *head, *ended(6)),
        },
        {
            "Value": Form(Value, *ended(1)),
            "Answer": Form(Answer, "kind" / schema.deciding(schema.choice(kinds, "ACK, NAK or EOT"))),
        },
        alike=("ei-bisynch", lift),
    )
