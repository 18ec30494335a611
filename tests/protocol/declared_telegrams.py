"""Declared telegrams of three protocols, whose length is set by a code, a constant or a length field.

Mitsubishi's computer link: FR-D700 manual, pages 189 to 192. LECOM-A/B: Lenze EDB2102EN, pages 8-16 to 8-23. Control
Techniques' ANSI protocol: UD70 user guide, pages 6-7 to 6-11.
"""

from dataclasses import dataclass, make_dataclass
from typing import ClassVar

from construct import this

from drivecomm.protocol.schema import (
    Check,
    Form,
    Telegrams,
    characters,
    choice,
    constant,
    deciding,
    decimal_number,
    hex_number,
    hex_sum,
    one_of,
    unsigned,
    until,
    xor_byte,
)

EOT, ENQ, STX, ETX, ACK, NAK = b"\x04", b"\x05", b"\x02", b"\x03", b"\x06", b"\x15"


def message(kind, *names):
    """Return a telegram class with these fields."""
    known = [(name, object) for name in names]
    return make_dataclass(
        kind.title().replace("_", ""),
        [*known, ("kind", ClassVar[str], kind)],
        frozen=True,
        slots=True,
        kw_only=True,
        namespace={"__module__": __name__},
    )


def without_etx(covered):
    return hex_sum(covered[:-1])


TWO_DIGITS = frozenset({0x6C, 0x73, 0x7A, 0x7F, 0xEC, 0xF3, 0xFA, 0xFF})


def mitsubishi():
    """Return telegrams whose instruction code decides the number of digits; in a reply the place of ETX does."""
    station = "address" / deciding(hex_number(2, allowed=range(32)))
    wait = "wait" / hex_number(1)

    def request(kind, codes, *data):
        code = "code" / deciding(hex_number(2, "code", allowed=codes))
        return Form(kind, constant(ENQ), station, code, wait, *data, Check(2, 1, hex_sum))

    def value(digits):
        kind = message(f"value{digits}", "address", "data")
        return Form(kind, constant(STX), station, "data" / hex_number(digits), constant(ETX), Check(2, 1, without_etx))

    writes = set(range(0x80, 0x100))
    asked = "address", "code", "wait"
    return Telegrams(
        {
            "Read": request(message("read", *asked), range(0x80)),
            "Write, 2": request(message("write2", *asked, "data"), writes & TWO_DIGITS, "data" / hex_number(2)),
            "Write, 4": request(message("write4", *asked, "data"), writes - TWO_DIGITS, "data" / hex_number(4)),
        },
        {
            "Value, 2": value(2),
            "Value, 4": value(4),
            "ACK": Form(message("ack", "address"), constant(ACK), station),
            "NAK": Form(message("nak", "address", "error"), constant(NAK), station, "error" / hex_number(1)),
        },
    )


def _code_characters(number):
    within = number % 790
    return bytes([within // 10 + 0x30, within % 10 + number // 790 * 10 + 0x30])


def lecom():
    """Return telegrams whose value ends at ETX; the BCC that follows may be any byte, even ETX."""
    address = "address" / decimal_number(2)
    code = "code" / one_of(range(6230), _code_characters, "C1 and C2")
    value = "value" / characters(until(ETX, least=1, most=20))
    written = (constant(STX), code, value, constant(ETX))
    return Telegrams(
        {
            "RECEIVE": Form(message("receive", "address", "code"), constant(EOT), address, code, constant(ENQ)),
            "SEND": Form(
                message("send", "address", "code", "value"), constant(EOT), address, *written, Check(1, 4, xor_byte)
            ),
        },
        {
            "Value": Form(message("value", "code", "value"), *written, Check(1, 1, xor_byte)),
            "Unknown code": Form(message("unknown", "code"), constant(STX), code, constant(EOT)),
            "ACK": Form(message("ack"), constant(ACK)),
            "NAK": Form(message("nak"), constant(NAK)),
        },
    )


def lifted(covered):
    bcc = xor_byte(covered)
    return bcc if bcc[0] >= 0x20 else bytes([bcc[0] + 0x20])


def _doubled(unit):
    return b"".join(2 * digit.encode() for digit in f"{unit:02d}")


def ct_ansi():
    """Return telegrams as those of LECOM, but with each address digit sent twice; a reply may be a single EOT."""
    address = "address" / one_of(range(100), _doubled, "group and unit, each twice")
    parameter = "parameter" / decimal_number(4, meaning="menu and parameter")
    written = (constant(STX), parameter, "value" / characters(until(ETX, least=1, most=12)), constant(ETX))
    return Telegrams(
        {
            "Read": Form(message("read", "address", "parameter"), constant(EOT), address, parameter, constant(ENQ)),
            "Write": Form(
                message("write", "address", "parameter", "value"), constant(EOT), address, *written, Check(1, 6, lifted)
            ),
        },
        {
            "Value": Form(message("value", "parameter", "value"), *written, Check(1, 1, lifted)),
            "No such parameter": Form(message("unknown"), constant(EOT)),
            "ACK": Form(message("ack"), constant(ACK)),
            "NAK": Form(message("nak"), constant(NAK)),
        },
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Block:
    """A telegram whose first byte counts the rest; several forms share its class."""

    kind: str
    words: str | None = None
    word: int | None = None


def counted():
    """Return telegrams with a length field and with fields that choose the form of a message.

    One of the telegrams is the start of another.
    """

    letters = (("many", b"M"), ("one", b"O"), ("x", b"x"))
    kind = {name: "kind" / deciding(choice({letter: name})) for name, letter in letters}
    words = "words" / characters(this.length - 1, lowest=0, highest=255)
    length, check = "length" / unsigned(1, allowed=range(1, 9)), Check(1, 0, xor_byte)
    sized = {"length": lambda block: 1 + len(block.words)}
    number = "word" / deciding(unsigned(1, allowed=range(9)))
    return Telegrams(
        {
            "Many": Form(Block, constant(b"#"), kind["many"], length, words, check, writes=sized),
            "One": Form(Block, constant(b"#"), kind["one"], "word" / unsigned(2), check),
            "End": Form(message("end"), constant(b"#")),
        },
        {
            "With a number": Form(
                Block, constant(b"!"), kind["x"], number, check, when=lambda block: block.word is not None
            ),
            "Without": Form(Block, constant(b"!"), kind["x"], constant(b"-"), check),
        },
    )
