"""Telegrams of VABus.

Short description of VABus for CM-232 / CM-485, sections 5 to 7; Agile VABus manual VEC 686 R0, pages 25-41.

    enquiry  EOT ADR SYS ds n n n ENQ                          master reads
    select   EOT ADR STX SYS ds n n n a a w...w ETX BCC        master writes
    value        ADR STX SYS ds n n n a a w...w ETX BCC        drive answers an enquiry
    ack          ADR ACK                                       drive has accepted a select
    nak          ADR NAK                                       drive refuses an enquiry or a select
    eot      EOT                                               master closes the exchange

ADR is 40H plus the node. SYS is the system-bus node behind the drive, 0 for the drive itself. ds is the data set, nnn
the parameter, aa the number of data characters in decimal. BCC is the exclusive-or of everything after STX up to and
including ETX: it covers neither ADR nor EOT, and it may be any 7-bit character, so reception relies on the length and
never looks for a control character inside a block.

Faults to expect: a wrong BCC, a cut telegram, a reply of another drive, an ACK that belongs to an earlier select (ACK
and NAK name no parameter).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, ClassVar, Literal, TypeAlias

from construct import this

from drivecomm.protocol import Intent, difference
from drivecomm.protocol.schema import (
    CheckCharacters,
    Form,
    Telegrams,
    characters,
    choice,
    constant,
    deciding,
    decimal_number,
    hex_value,
    one_of,
    shifted_character,
    wrong_field,
    xor_byte,
)

if TYPE_CHECKING:
    from drivecomm.protocol import Direction, Message

ValueType: TypeAlias = Literal["", "uint", "int", "long", "string"]
RANGES = {"uint": range(2**16), "int": range(-(2**15), 2**15), "long": range(-(2**31), 2**31)}
VALUE_TYPES = (*RANGES, "string")

EOT, ENQ, STX, ETX, ACK, NAK = b"\x04", b"\x05", b"\x02", b"\x03", b"\x06", b"\x15"

NODES = range(1, 31)
BROADCAST = 32
DATASETS = range(10)
PARAMETERS = range(1600)


@dataclass(frozen=True, slots=True, kw_only=True)
class _OfParameter:
    address: int
    sys: int = 0
    dataset: int = 0
    parameter: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Enquiry(_OfParameter):
    """A read request for a parameter."""

    kind: ClassVar[str] = "enquiry"


@dataclass(frozen=True, slots=True, kw_only=True)
class Select(_OfParameter):
    """A write request for a parameter. data: its characters."""

    kind: ClassVar[str] = "select"
    data: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Value(_OfParameter):
    """A reply with a parameter's value. data: its characters."""

    kind: ClassVar[str] = "value"
    data: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Ack:
    """A reply that accepts a select."""

    kind: ClassVar[str] = "ack"
    address: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Nak:
    """A refusal; the error register of the drive (parameter 11) has the reason."""

    kind: ClassVar[str] = "nak"
    address: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Eot:
    """The end of an exchange, sent by the master."""

    kind: ClassVar[str] = "eot"


def _node(allowed: Any) -> Any:
    return "address" / deciding(shifted_character(0x40, allowed, "40H + node, 60H for all"))


def _length(message: Select | Value) -> int:
    return len(message.data) if isinstance(message.data, str) else 1


def _with_data(message: type[Any], *head: Any, covered_from: int, type: ValueType, lower_case_hex: bool) -> Form[Any]:
    """Return the form of a telegram with data and this beginning; the BCC covers everything from SYS on."""

    def checked(data: str) -> str:
        try:
            number_of(data, type, lower_case_hex=lower_case_hex)
        except ValueError as error:
            raise wrong_field("data", str(error)) from None
        return data

    def check(message: Select | Value) -> None:
        checked(message.data)

    return Form(
        message,
        *head,
        constant(STX, "STX"),
        *_PLACE,
        "length" / decimal_number(2, range(1, 100), "number of data characters, decimal"),
        "data" / characters(this.length, meaning="hexadecimal digits, or text"),
        constant(ETX, "ETX"),
        CheckCharacters(1, covered_from, xor_byte, meaning="BCC: exclusive-or from SYS to ETX"),
        reads={"data": checked} if type in RANGES else None,
        writes={"length": _length},
        check=check if type in RANGES else None,
    )


def _not_to_all(enquiry: Enquiry) -> None:
    if enquiry.address == BROADCAST:
        raise wrong_field("address", "an enquiry cannot be a broadcast, because no drive would answer")


_NODES_BEHIND = {b"0": 0} | {bytes([0x40 + node]): node for node in range(1, 64)}
"""SYS: the drive itself, or a node on its system bus (Agile VABus manual p. 26, 30)."""
_PLACE = (
    "sys" / deciding(choice(_NODES_BEHIND, "system-bus node: `0`, or 40H + 1..63")),
    "dataset" / decimal_number(1, meaning="data set 0..9"),
    # From 1000 on the hundreds are a letter; 1200 is C00 (Agile VABus manual p. 30).
    "parameter"
    / one_of(PARAMETERS, lambda number: b"%X%02d" % divmod(number, 100), "parameter 0..999, A00..F99 for 1000..1599"),
)
_EOT = constant(EOT, "EOT")
_ANYBODY = frozenset([*NODES, BROADCAST])


@cache
def telegrams(type: ValueType = "", *, lower_case_hex: bool = False) -> Telegrams:
    """Return the codec. An EOT on its own is also a telegram, unless an enquiry or a select follows it.

    type: type of the data in the parameter table, so that they are checked: uint and int have four hexadecimal digits,
    long has eight. lower_case_hex: accept a-f in them (never shown in a manual).
    """
    checked: dict[str, Any] = {"type": type, "lower_case_hex": lower_case_hex}
    return Telegrams(
        requests={
            "Enquiry": Form(Enquiry, _EOT, _node(_ANYBODY), *_PLACE, constant(ENQ, "ENQ"), check=_not_to_all),
            "Select": _with_data(Select, _EOT, _node(_ANYBODY), covered_from=3, **checked),
            "EOT": Form(Eot, _EOT),
        },
        replies={
            "Value": _with_data(Value, _node(NODES), covered_from=2, **checked),
            "ACK": Form(Ack, _node(NODES), constant(ACK, "ACK")),
            "NAK": Form(Nak, _node(NODES), constant(NAK, "NAK")),
        },
        alike=("vabus", type, lower_case_hex),
    )


def number_of(data: str, type: str, *, lower_case_hex: bool = False) -> int:
    """Return the number for data characters: two's complement for int and long.

    Short description, section 6.6; Agile VABus manual p. 31, 39, 41. Raises ValueError if they are not such a number.
    """
    if len(data) != digits_of(type):
        raise ValueError(f"{data!r} has {len(data)} characters, a value of type {type} has {digits_of(type)}")
    value = hex_value((data.upper() if lower_case_hex else data).encode("latin-1"))
    return value if value in range_of(type) else value - len(range_of(type))


def data_of(value: int, type: str) -> str:
    """Return the data characters for a number. Raises ValueError if it does not fit the type."""
    allowed = range_of(type)
    # `in` on a range is slow for a Decimal, so convert to int first.
    if value != int(value) or int(value) not in allowed:
        raise ValueError(f"{value} is not a whole number from {allowed[0]} to {allowed[-1]}, the range of type {type}")
    return f"{int(value) % len(allowed):0{digits_of(type)}X}"


def range_of(type: str) -> range:
    """Return the numbers of this type; those of an int for an unknown type."""
    return RANGES.get(type, RANGES["int"])


def digits_of(type: str) -> int:
    """Return the number of hexadecimal digits of a number of this type."""
    return 8 if type == "long" else 4


def intent(request: Message) -> Intent:
    """Return the intent of a request.

    Control word and reference are parameters as well, and EOT only ends an exchange.
    """
    if isinstance(request, Enquiry):
        return Intent(access="read")
    return Intent(access="write") if isinstance(request, Select) else Intent(commands=not isinstance(request, Eot))


def mismatch(request: Message, reply: Message) -> str:
    """Return the first field in which a sound reply does not belong to a request; empty if it belongs.

    Sections 4, 6 and 17 of the specification: ADR is outside the BCC, and an ACK names only its sender.
    """
    if not isinstance(request, Enquiry | Select):
        return "kind"
    if not isinstance(reply, Value | Ack | Nak) or reply.address != request.address:
        return "address"
    if isinstance(reply, Nak):
        return ""
    if isinstance(reply, Value) is not isinstance(request, Enquiry):
        return "kind"
    return difference(request, reply, "sys", "dataset", "parameter") if isinstance(reply, Value) else ""


def blind_spots(data: bytes, direction: Direction) -> frozenset[int]:
    """Return the positions where one wrong bit is not detected: ADR, and all of an enquiry between EOT and ENQ."""
    if direction == "reply":
        return frozenset([0])
    if len(data) == 1:
        return frozenset()
    return frozenset([1]) if data[2:3] == STX else frozenset(range(1, len(data) - 1))
