"""Telegrams of LECOM-A/B (Lenze EDB2102EN "Fieldbus module type 2102", 10/2003: L; SMVector CMVLC401A: SMV).

    RECEIVE  EOT AD1 AD2 code ENQ                     SEND    EOT AD1 AD2 STX code value ETX BCC
    answers  STX code value ETX BCC                   answers ACK or NAK, which name nothing
             STX code "?" ETX BCC   damaged request
             STX code EOT           unknown code

(L p. 8-20 to 8-23, SMV p. 15, 16.) LECOM-A, -B and -LI are the same telegrams over RS-232, RS-485 and fibre. L p. 8-16
and SMV p. 10 print EOT as 02; it is 04 (L p. 8-21). BCC is the exclusive-or of all characters behind STX up to ETX, one
byte of any value, even that of ETX (L p. 8-20, SMV p. 14); other relatives of X3.28 add 20H to small values.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from decimal import Decimal
from typing import Any

from drivecomm.protocol import schema
from drivecomm.protocol.schema import Form, Leaf, constant

CODES = range(6230)  # codes that two characters can express (L p. 8-16)
_STX, _ETX, _EOT, _ENQ, _ACK, _NAK = (bytes([each]) for each in (0x02, 0x03, 0x04, 0x05, 0x06, 0x15))
_DECIMAL, _HIGHEST = re.compile(r"-?[0-9]{1,6}(\.[0-9]{1,4})?", re.ASCII), Decimal("214748.3647")
_VALUE = re.compile("H([0-9A-F]{2}|[0-9A-F]{4}|[0-9A-F]{8})|O([0-9A-F]{2}){1,120}|S[ -~]{1,240}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """A RECEIVE or SEND telegram.

    extended: whether seven characters name code and subcode (L p. 8-18). data: the value as printed in the telegram.
    """

    kind: str
    address: int
    code: int
    subcode: int = 0
    extended: bool = False
    data: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Reply:
    """An answer, which never names the drive. code: None in an acknowledgement, which names nothing."""

    kind: str
    code: int | None = None
    subcode: int = 0
    extended: bool = False
    data: str | None = None


def _code_in(found: bytes) -> int:
    """Return the code that two characters express (L p. 8-16)."""
    first, second = found[0] - 0x30, found[1] - 0x30
    code = first * 10 + second % 10 + 790 * (second // 10)
    if code not in CODES or _code_as(code) != found:
        raise ValueError(f"{found!r} is not a code number")
    return code


def _code_as(code: int) -> bytes:
    rest = code % 790
    return bytes([rest // 10 + 0x30, rest % 10 + code // 790 * 10 + 0x30])


def _checked(data: str, kind: str) -> str:
    """Return a valid value: decimal, H, O or S (L p. 8-18, 8-19). Texts occur only in answers.

    Raises a field error for any other value.
    """
    is_text = isinstance(data, str)
    is_decimal = is_text and _DECIMAL.fullmatch(data) and Decimal("-214748.3648") <= Decimal(data) <= _HIGHEST
    if not is_decimal and not (is_text and _VALUE.fullmatch(data) and (data[0] != "S" or kind == "value")):
        raise schema.wrong_field("data", "it is missing" if data is None else f"{data!r} is not a value")
    return data


def _form(message: type[Any], kind: str, *leaves: Any, extended: bool | None = None) -> Form[Any]:
    """Return the form of a kind of telegram.

    extended: True for extended addressing of the code, False for two characters, None for a telegram without a code.
    """
    reads: dict[str, Any] = {"kind": lambda: kind} | ({"extended": lambda: True} if extended else {})
    writes: dict[str, Any] = {}
    if kind in ("value", "send"):
        reads["data"] = lambda first, rest: _checked(first + rest, kind)
        writes["first rest"] = lambda given: (_checked(given.data, kind)[0], given.data[1:])

    def check(given: Any) -> None:
        if given.kind != kind:
            raise schema.wrong_field("kind", f"{given.kind!r} is not a kind of telegram")
        if extended and given.extended is not True:
            raise schema.wrong_field("extended", "only extended addressing names a subcode")
        if kind == "receive" and type(given.address) is int and not given.address % 10:
            raise schema.wrong_field("address", "no drive answers at a group address (L p. 6-3)")

    def when(given: Any) -> bool:
        return given.kind == kind and (extended is None or extended == bool(given.extended or given.subcode))

    return Form(message, *leaves, reads=reads, writes=writes, check=check, when=when)


def _both(title: str, message: type[Any], kind: str, before: list[Any], *behind: Any) -> dict[str, Form[Any]]:
    """Return two forms of a telegram, with the short and with the extended code between these leaves."""
    code = "code" / Leaf(2, _code_in, _code_as, values=CODES, meaning="code number")
    seven = constant(b"!"), "code" / schema.hex_number(4, "code"), "subcode" / schema.hex_number(2, "subcode")
    return {
        title: _form(message, kind, *before, code, *behind, extended=False),
        f"{title}, extended": _form(message, kind, *before, *seven, *behind, extended=True),
    }


_FIRST, _PRINTABLE = {each.encode(): each for each in "-0123456789HSO"}, bytes(range(0x20, 0x7F))
_VALUES = (
    "first" / schema.deciding(schema.choice(_FIRST, "a digit, -, H, S or O")),
    "rest" / Leaf(schema.until(_ETX, most=240), bytes.decode, str.encode, meaning="value", alphabet=_PRINTABLE),
)
_HEAD = [constant(_EOT, "EOT"), "address" / schema.decimal_number(2, meaning="address; a group's ends in 0")]
_TOP = [constant(_STX, "STX")]


def _end(start: int) -> tuple[Any, ...]:
    return constant(_ETX, "ETX"), schema.CheckCharacters(1, start, schema.xor_byte, meaning="BCC")


TELEGRAMS = schema.Telegrams(
    {
        **_both("Receive", Request, "receive", _HEAD, constant(_ENQ, "ENQ")),
        **_both("Send", Request, "send", _HEAD + _TOP, *_VALUES, *_end(4)),
    },
    {
        **_both("Value", Reply, "value", _TOP, *_VALUES, *_end(1)),
        **_both("Damaged", Reply, "fault", _TOP, constant(b"?"), *_end(1)),
        **_both("Unknown code", Reply, "unknown", _TOP, constant(_EOT, "EOT")),
        "ACK": _form(Reply, "ack", constant(_ACK, "ACK")),
        "NAK": _form(Reply, "nak", constant(_NAK, "NAK")),
    },
    alike="lecom",
)
"""The codec. A code number never begins with `!`, because its first character is 30 to 7E."""
