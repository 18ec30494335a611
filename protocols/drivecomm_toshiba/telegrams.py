"""Telegrams of Toshiba's inverter protocol, in ASCII and in binary.

    ASCII     "(" [number] command communication-number [data] ["&" sum] ")" CR
    binary    "/" [number] command communication-number [data] sum

ASCII: VF-S15 manual E6581913 p. 7 (requests), 8 (replies); VF-S11 manual E6581222 p. 9. The sum is the low byte of the
sum of all characters from "(" to "&", in two hexadecimal digits; it is omitted together with its "&" (VF-AS1 manual
E6581315 p. 7). Binary: E6581222 p. 11, 12; a drive distinguishes the two by their first character (E6581913 p. 6). R
reads, W writes RAM and EEPROM, P writes RAM, G is a binary R with dummy data; X is a block of written and read data
(E6581913 p. 13), and is never sent from here. A reply repeats its request, in lower case while the drive is tripped
(E6581913 p. 8). N refuses, with a code and no communication number (E6581315 p. 16, 20). Wild cards: "*2" is 02, 12, 22
and so on, "**" is all drives.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

from construct import this

from drivecomm.protocol import schema
from drivecomm.protocol.schema import Form, characters, choice, constant, deciding, hex_number, unsigned, until

ADDRESSES, BROADCAST = range(100), 255
_WILD = {f"*{digit}": 200 + digit for digit in range(10)} | {f"{n}*": 210 + n for n in range(10)} | {"**": BROADCAST}
_ASCII_NUMBERS = {b"%02d" % each: each for each in ADDRESSES} | {each.encode(): each for each in _WILD}
_BINARY_NUMBERS = {bytes([each]): each for each in range(0x40)} | {b"\xff": "**"}
"""Numbers in telegrams; 00H to 3FH and FFH in binary (E6581222 p. 11)."""
KINDS = {"R": "read", "G": "read", "W": "write", "P": "write", "X": "block", "N": "refused"}


@dataclass(frozen=True, slots=True, kw_only=True)
class ToshibaOptions:
    """Options of a drive. sum: whether ASCII telegrams have a check sum; without it, damage can go undetected."""

    sum: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class Telegram:
    """One telegram.

    number: number of the drive; None if omitted, a text for a wild card. address: the same as a number; 255 is all
    drives, 200 + n and 210 + n are those that end and begin with n. command: R, W, P, G, X or N.
    """

    mode: str = "ascii"
    number: int | str | None = None
    address: int | None = None
    command: str
    communication_number: int | None = None
    data: int | None = None

    def __post_init__(self) -> None:
        if self.address is None:
            object.__setattr__(self, "address", address_of(self.number))
        else:
            names = [each for each, address in _WILD.items() if address == self.address]
            object.__setattr__(self, "number", names[0] if names else self.address)

    @property
    def kind(self) -> str:
        """The kind of the telegram: read, write, block or refused."""
        return KINDS.get(self.command, "")


@dataclass(frozen=True, slots=True, kw_only=True)
class Request(Telegram):
    """A telegram of the master.

    digits: number of digits of the data, four in requests from here. written, answers: the data that a block writes,
    and how many it reads.
    """

    digits: int = 4
    written: tuple[int, ...] | None = None
    answers: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Reply(Telegram):
    """A reply of a drive. tripped: whether it is in lower case. error_code: code of a refusal."""

    tripped: bool = False
    error_code: int | None = None


def address_of(number: Any) -> Any:
    """Return the address for a number in a telegram."""
    return _WILD.get(number) if isinstance(number, str) else number


def smallest(number: Any) -> Any:
    """Return the number of the drive that answers a wild card: 0 in place of each `*` (E6581913 p. 8)."""
    return int(number.replace("*", "0")) if number in _WILD else number


def _in_hex(text: str) -> tuple[int | None, int]:
    return (schema.hex_value(text.encode("latin-1")) if text else None), len(text)


def _as_hex(request: Any) -> str:
    data, digits = request.data, request.digits
    if (data, digits) != (None, 0) and not (type(data) is int and digits in range(1, 5) and 0 <= data < 16**digits):
        raise schema.wrong_field("data", f"{data!r} does not go into {digits!r} digits")
    return f"{data:0{digits}X}" if digits else ""


def _pair(mode: str, title: str, message: type[Any], commands: str, *leaves: Any, **how: Any) -> dict[str, Form[Any]]:
    """Return the two forms with and without a number.

    commands: commands of the form; a reply may have them in lower case.
    """
    start, numbers = (b"(", _ASCII_NUMBERS) if mode == "ascii" else (b"/", _BINARY_NUMBERS)
    cases = [(each, False) for each in commands] + [(each, True) for each in commands if message is Reply]
    told = {(each.lower() if tripped else each).encode(): (each, tripped) for each, tripped in cases}
    reads: dict[str, Any] = {"command": lambda told: told[0], "mode": lambda: mode}
    if message is Reply:
        reads["tripped"] = lambda told: told[1]

    def check(given: Any) -> None:
        if given.mode != mode or given.command == "X":
            raise schema.wrong_field("mode", "it is ascii or binary, and blocks are not sent from here")

    def made(*number: Any) -> Form[Any]:
        return Form(
            message,
            constant(start, start.decode()),
            *number,
            "told" / deciding(choice(told, "command")),
            *leaves,
            reads={**reads, **({"address": address_of} if number else {}), **how.get("reads", {})},
            writes={"told": lambda given: (given.command, getattr(given, "tripped", False)), **how.get("writes", {})},
            check=check,
            when=lambda it: it.mode == mode and (it.number is None) != bool(number) and (it.command, False) in cases,
        )

    number = "number" / deciding(choice(numbers, "number of the drive"))
    return {f"{title}, {mode}": made(number), f"{title}, {mode}, without a number": made()}


@cache
def codec_for(options: ToshibaOptions) -> schema.Telegrams:
    """Return the codec of ASCII telegrams with or without a sum; binary ones always have one."""
    check = schema.CheckCharacters(2, 0, lambda covered: b"%02X" % (sum(covered) & 0xFF), meaning="sum of all to &")
    end = (*((constant(b"&", "&"), check) if options.sum else ()), constant(b")", ")"), constant(b"\r", "CR"))
    text = "text" / characters(until(b"&" if options.sum else b")", most=4), meaning="data")
    total = schema.CheckCharacters(1, 0, lambda covered: bytes([sum(covered) & 0xFF]), meaning="sum of all before it")
    name, code, data = ("communication_number", "error_code", "data")
    ascii_name, binary_name = name / hex_number(4), name / unsigned(2)
    digits = {"reads": {"data digits": _in_hex}, "writes": {"text": _as_hex}}
    block = ("count" / unsigned(1, allowed=range(3)), "answers" / unsigned(1))
    words = "content" / characters(2 * this.count, lowest=0, highest=0xFF)
    return schema.Telegrams(
        {
            **_pair("ascii", "Read", Request, "R", ascii_name, *end),
            **_pair("ascii", "Write", Request, "WP", ascii_name, text, *end, **digits),
            **_pair("binary", "Read", Request, "R", binary_name, total),
            **_pair("binary", "Write", Request, "WPG", binary_name, data / unsigned(2), total),
            **_pair("binary", "Block", Request, "X", *block, words, total, reads={"written": schema.words_in}),
        },
        {
            **_pair("ascii", "Done", Reply, "RWP", ascii_name, data / hex_number(4), *end),
            **_pair("ascii", "Refused", Reply, "N", code / hex_number(4), *end),
            **_pair("binary", "Done", Reply, "RWPG", binary_name, data / unsigned(2), total),
            **_pair("binary", "Refused", Reply, "N", code / unsigned(2), total),
        },
    )
