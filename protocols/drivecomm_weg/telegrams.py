"""Telegrams of WEG's serial protocol, after ISO 1745 (CFW-08 manual p. 137, 138, 144, 180; CFW-09 p. 304, 305).

    read    EOT ADR code ENQ                        answers   ADR STX code "=" value ETX BCC, or NAK
    write   EOT ADR STX code "=" value ETX BCC      answers   ADR ACK, or NAK
    end     EOT                                     the master ends an exchange
                                                    NAK       ADR NAK

ADR is 40H plus the address: G is 7, J is 10. A code has five decimal digits: 0, then 0 for the basic variables and
n + 1 for parameters n00 to n99, then 7 for a CFW-08, 8 for a CFW-09 and 9 for any, then the last two digits (CFW-08
p. 180). A value has four hexadecimal digits, with letters printed in upper case. BCC is the exclusive-or of all
characters behind STX up to ETX, any 7-bit character, even that of EOT. Bit 8 is even parity (MVW3000 p. 9-16).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

from drivecomm.protocol import schema
from drivecomm.protocol.schema import Form, Leaf, constant

ADDRESSES, NOBODY = range(1, 31), 0
_EOT, _ENQ, _STX, _ETX, _ACK, _NAK = (
    constant(bytes([byte]), name)
    for byte, name in ((4, "EOT"), (5, "ENQ"), (2, "STX"), (3, "ETX"), (6, "ACK"), (0x15, "NAK"))
)
_CODE = re.compile(rb"0[0-7][7-9][0-9]{2}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Telegram:
    """One telegram. code: five digits, as printed. value: a word."""

    kind: str
    address: int | None = None
    code: str | None = None
    value: int | None = None


class Request(Telegram):
    """A telegram of the master: read, write or end."""


class Reply(Telegram):
    """A reply of a drive: data, ack or nak."""


def _code_in(found: bytes) -> str:
    if not _CODE.fullmatch(found):
        raise ValueError(f"{found!r} is not 0, a digit up to 7, the equipment 7 to 9, and two digits")
    return found.decode("ascii")


def _code_as(code: str) -> bytes:
    return _code_in(code.encode("ascii")).encode("ascii")


def _form(message: type[Any], kind: str, *leaves: Any) -> Form[Any]:
    def check(given: Any) -> None:
        if given.kind != kind:
            raise schema.wrong_field("kind", f"{given.kind!r} is not a telegram of this direction")
        if message is Request and type(given.address) is int and given.address == NOBODY:
            raise schema.wrong_field("address", "what @, the address 0, means is on no page, and it is never sent")

    writes = {"separator": lambda _: "="} if kind in ("write", "data") else {}
    return Form(
        message, *leaves, reads={"kind": lambda: kind}, writes=writes, check=check, when=lambda it: it.kind == kind
    )  # fmt: skip


def _value(covered_from: int) -> tuple[Any, ...]:
    return (
        _STX,
        _CODE_LEAF,
        "separator" / schema.choice({b"=": "="}, "="),  # another character is a wrong field, not noise
        "value" / schema.hex_number(4, "value"),
        _ETX,
        schema.CheckCharacters(1, covered_from, schema.xor_byte, meaning="BCC: all behind STX"),
    )


_ADDRESS = "address" / schema.deciding(schema.shifted_character(0x40, range(31), "40H + address"))
_CODE_LEAF = "code" / Leaf(5, _code_in, _code_as, meaning="code of a variable", alphabet=b"0123456789")
TELEGRAMS = schema.Telegrams(
    {
        "Read": _form(Request, "read", _EOT, _ADDRESS, _CODE_LEAF, _ENQ),
        "Write": _form(Request, "write", _EOT, _ADDRESS, *_value(3)),
        "End": _form(Request, "end", _EOT),
    },
    {
        "Data": _form(Reply, "data", _ADDRESS, *_value(2)),
        "Done": _form(Reply, "ack", _ADDRESS, _ACK),
        "Refused": _form(Reply, "nak", _ADDRESS, _NAK),
    },
)
