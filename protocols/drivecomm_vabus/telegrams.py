"""The telegrams of VABus.

Short description of VABus for CM-232 / CM-485, sections 5 to 7; Agile VABus manual VEC 686 R0, pages 25-41.

    enquiry  EOT ADR SYS ds n n n ENQ                          master reads
    select   EOT ADR STX SYS ds n n n a a w...w ETX BCC        master writes
    value        ADR STX SYS ds n n n a a w...w ETX BCC        drive answers an enquiry
    ack          ADR ACK                                       drive has taken a select
    nak          ADR NAK                                       drive refuses an enquiry or a select
    eot      EOT                                               master closes the exchange

ADR is 40H plus the node. SYS is the system-bus node behind the drive, 0 for the drive itself. ds is the data set, nnn
the parameter, aa the number of data characters in decimal. BCC is the exclusive-or of everything after STX up to and
including ETX: it covers neither ADR nor EOT, and it may be any 7-bit character, so reception goes by length and never
looks for a control character inside a block.

Faults to expect: a wrong BCC, a cut telegram, a reply of another drive, an ACK that belongs to an earlier select (ACK
and NAK name no parameter).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Literal, TypeAlias

from construct import this

from drivecomm.errors import TelegramError, UsageError
from drivecomm.protocol import Intent
from drivecomm.protocol.schema import (
    Check,
    Form,
    Leaf,
    characters,
    constant,
    decimal_number,
    hex_value,
    message_of,
    shifted_character,
    xor_byte,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.protocol import Direction, Message

ValueType: TypeAlias = Literal["", "uint", "int", "long", "string"]
VALUE_TYPES = ("uint", "int", "long", "string")

EOT, ENQ, STX, ETX, ACK, NAK = b"\x04", b"\x05", b"\x02", b"\x03", b"\x06", b"\x15"

NODES = range(1, 31)
BROADCAST = 32
DATASETS = range(10)
PARAMETERS = range(1600)


@dataclass(frozen=True, slots=True, kw_only=True)
class Enquiry:
    """The master asks for a parameter."""

    kind: ClassVar[str] = "enquiry"
    address: int
    sys: int = 0
    dataset: int = 0
    parameter: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Select:
    """The master sets a parameter; data are its characters."""

    kind: ClassVar[str] = "select"
    address: int
    sys: int = 0
    dataset: int = 0
    parameter: int
    data: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Value:
    """The drive gives a parameter's value; data are its characters."""

    kind: ClassVar[str] = "value"
    address: int
    sys: int = 0
    dataset: int = 0
    parameter: int
    data: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Ack:
    """The drive has taken a select."""

    kind: ClassVar[str] = "ack"
    address: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Nak:
    """The drive refuses; its error register (parameter 11) says why."""

    kind: ClassVar[str] = "nak"
    address: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Eot:
    """The master closes the exchange."""

    kind: ClassVar[str] = "eot"


Request: TypeAlias = Enquiry | Select | Eot
Reply: TypeAlias = Value | Ack | Nak
_WITH_DATA = (Select, Value)


def _sys() -> Leaf:
    """`0` for the drive itself, 40H plus the node for nodes 1 to 63 (Agile VABus manual p. 26, 30)."""

    def parse(found: bytes) -> int:
        if found == b"0":
            return 0
        if found[0] < 0x41 or found[0] > 0x7F:
            raise ValueError(f"{found!r} names no system-bus node")
        return found[0] - 0x40

    def write(node: int) -> bytes:
        if node not in range(64):
            raise ValueError(f"system-bus node {node!r} is not 0 to 63")
        return bytes([0x40 + node]) if node else b"0"

    return Leaf(1, parse, write, meaning="system-bus node: `0`, or 40H + 1..63", values=range(64))


def _number() -> Leaf:
    """Three characters; from 1000 on the hundreds are a letter, 1200 is C00 (Agile VABus manual p. 30)."""

    def parse(found: bytes) -> int:
        hundreds = "0123456789ABCDEF".find(chr(found[0]))
        if hundreds < 0 or not found[1:].isdigit():
            raise ValueError(f"{found!r} is no parameter number")
        return hundreds * 100 + int(found[1:])

    def write(number: int) -> bytes:
        if type(number) is not int or number not in PARAMETERS:
            raise ValueError(f"parameter {number!r} is not 0 to 1599")
        return b"%X%02d" % (number // 100, number % 100)

    return Leaf(3, parse, write, meaning="parameter 0..999, A00..F99 for 1000..1599", values=PARAMETERS)


def _node(allowed: Any) -> Any:
    return "address" / shifted_character(0x40, allowed, "40H + node, 60H for all")


_HEAD = (
    "sys" / _sys(),
    "dataset" / decimal_number(1, meaning="data set 0..9"),
    "parameter" / _number(),
)
_BLOCK = (
    *_HEAD,
    "length" / decimal_number(2, range(1, 100), "number of data characters, decimal"),
    "data" / characters(this.length, meaning="hexadecimal digits, or text"),
    constant(ETX, "ETX"),
)
_ANYBODY = frozenset([*NODES, BROADCAST])


def _length(message: Select | Value) -> int:
    return len(message.data) if isinstance(message.data, str) else 1


ENQUIRY = Form(Enquiry, constant(EOT, "EOT"), _node(_ANYBODY), *_HEAD, constant(ENQ, "ENQ"))
SELECT = Form(
    Select,
    constant(EOT, "EOT"),
    _node(_ANYBODY),
    constant(STX, "STX"),
    *_BLOCK,
    Check(1, 3, xor_byte, meaning="BCC: exclusive-or from SYS to ETX"),
    writes={"length": _length},
)
VALUE = Form(
    Value,
    _node(NODES),
    constant(STX, "STX"),
    *_BLOCK,
    Check(1, 2, xor_byte, meaning="BCC: exclusive-or from SYS to ETX"),
    writes={"length": _length},
)
ACKNOWLEDGE = Form(Ack, _node(NODES), constant(ACK, "ACK"))
REFUSE = Form(Nak, _node(NODES), constant(NAK, "NAK"))
CLOSE = Form(Eot, constant(EOT, "EOT"))

_FORMS: dict[type[Any], Form[Any]] = {
    form.message: form for form in (ENQUIRY, SELECT, VALUE, ACKNOWLEDGE, REFUSE, CLOSE)
}


class VabusCodec:
    """Telegrams to bytes and back.

    type: what the parameter table says of the data, so that they are checked: uint and int have four hexadecimal
    digits, long has eight. lower_case_hex: accept a-f in them (never shown in a manual).
    """

    def __init__(self, type: ValueType = "", *, lower_case_hex: bool = False) -> None:
        self.alike = ("vabus", type, lower_case_hex)
        self._type = type
        self._digits = type in ("uint", "int", "long")
        self._lower_case_hex = lower_case_hex

    def measure(self, head: bytes, direction: Direction) -> int:
        """Return how long the telegram is that begins with these bytes, see `Codec.measure`."""
        return _measure_request(head) if direction == "request" else _measure_reply(head)

    def decode(self, data: bytes, direction: Direction) -> Message:
        """Return the content of one telegram."""
        form = _request_form(data) if direction == "request" else _reply_form(data)
        message = _exactly(form, data)
        if self._digits and isinstance(message, _WITH_DATA):
            self._check_data(message.data)
        return message

    def encode(self, message: Message) -> bytes:
        """Return the bytes of one telegram; an enquiry to all drives is refused, nobody could answer it."""
        if isinstance(message, Enquiry) and message.address == BROADCAST:
            raise TelegramError("field", "an enquiry cannot be a broadcast, nobody would answer", field="address")
        if self._digits and isinstance(message, _WITH_DATA):
            self._check_data(message.data)
        return _FORMS[type(message)].build(message)

    def _check_data(self, data: str) -> None:
        try:
            number_of(data, self._type, lower_case_hex=self._lower_case_hex)
        except ValueError as error:
            raise TelegramError("field", f"data: {error}", field="data") from None


def number_of(data: str, type: ValueType, *, lower_case_hex: bool = False) -> int:
    """Return the number that data characters stand for: two's complement for int and long.

    Short description, section 6.6; Agile VABus manual p. 31, 39, 41. Raises ValueError when they are no such number.
    """
    digits = 8 if type == "long" else 4
    if len(data) != digits:
        raise ValueError(f"{data!r} has {len(data)} characters, a value of type {type} has {digits}")
    value = hex_value((data.upper() if lower_case_hex else data).encode("latin-1"))
    return value - 16**digits if type != "uint" and value >= 16**digits // 2 else value


def data_of(value: int, type: ValueType) -> str:
    """Return the data characters for a number. Raises ValueError when it does not fit the type."""
    digits = 8 if type == "long" else 4
    lowest, highest = (0, 0xFFFF) if type == "uint" else (-(16**digits) // 2, 16**digits // 2 - 1)
    if not lowest <= value <= highest:
        raise ValueError(f"{value} is not between {lowest} and {highest}, the range of type {type}")
    return f"{value % 16**digits:0{digits}X}"


def message_from(given: Mapping[str, Any], direction: Direction) -> Message:
    """Build a message from fields as test vectors name them."""
    kinds: tuple[type[Any], ...] = (Enquiry, Select, Eot) if direction == "request" else (Value, Ack, Nak)
    chosen = next((kind for kind in kinds if kind.kind == given.get("kind")), None)
    if chosen is None:
        allowed = ", ".join(kind.kind for kind in kinds)
        raise TelegramError("field", f"the kind of a {direction} is one of {allowed}", field="kind")
    message: Message = message_of(chosen, given, f"the {chosen.kind} telegram")
    return message


def _exactly(form: Form[Any], data: bytes) -> Message:
    """Parse; with all announced data characters there, no ETX behind them is worse than a wrong length.

    What is wrong is looked for once: on a line it costs ten times what a sound telegram does.
    """
    try:
        sound: Message = form.parse_compiled(data)
    except Exception:  # noqa: BLE001 - whatever it was, it is found again below and named
        needed = _needed(form, data)
    else:
        return sound
    if form in (SELECT, VALUE) and len(data) >= needed - 2 and data[needed - 2 : needed - 1] != ETX:
        # All data characters are there (section 18 of the specification).
        raise TelegramError("framing", "no ETX where the data characters that were announced end")
    if len(data) < needed:
        raise TelegramError("length", f"{needed} characters announced, {len(data)} there")
    if len(data) == needed:
        declared: Message = form.parse_declared(data)
        return declared
    try:
        form.parse(data[:needed])
    except TelegramError as error:
        if error.category == "framing":
            raise
    raise TelegramError("length", f"{len(data) - needed} characters too many")


def _needed(form: Form[Any], data: bytes) -> int:
    if form not in (SELECT, VALUE):
        return {ENQUIRY: 8, CLOSE: 1}.get(form, 2)
    start = 8 if form is SELECT else 7
    digits = data[start : start + 2]
    if len(digits) < 2:
        raise TelegramError("length", f"cut off after {len(data)} characters, before the number of data characters")
    if not digits.isdigit() or digits == b"00":
        raise TelegramError("length", f"{digits!r} is no number of data characters from 01 to 99", field="length")
    return start + 4 + int(digits)


_REPLY_FORMS: dict[bytes, Form[Any]] = {STX: VALUE, ACK: ACKNOWLEDGE, NAK: REFUSE}


def _request_form(data: bytes) -> Form[Any]:
    if not data:
        raise TelegramError("length", "no telegram, nothing at all")
    if data[:1] != EOT:
        raise TelegramError("framing", f"a request begins with EOT, not with {data[:1].hex().upper()}")
    if len(data) == 1:
        return CLOSE
    return SELECT if data[2:3] == STX else ENQUIRY


def _reply_form(data: bytes) -> Form[Any]:
    if len(data) < 2:
        raise TelegramError("length", f"a reply has at least 2 characters, not {len(data)}")
    form = _REPLY_FORMS.get(data[1:2])
    if form is None:
        raise TelegramError("framing", f"STX, ACK or NAK expected as second character, {data[1]:02X} found")
    return form


_SHORTEST_REQUEST, _SHORTEST_REPLY = 1, 2
"""EOT; ACK or NAK behind its address."""


def _measure_request(head: bytes) -> int:
    if not head:
        return _SHORTEST_REQUEST
    if head[:1] != EOT:
        return 0
    if len(head) < 2:
        return 2
    if head[1] - 0x40 not in _ANYBODY:
        return 1
    if len(head) < 3:
        return 3
    if head[2:3] == STX:
        return _block_length(head, 8) or 1
    return 8 if head[2] == 0x30 or head[2] > 0x40 else 1


def _measure_reply(head: bytes) -> int:
    if len(head) < 2:
        return _SHORTEST_REPLY if not head or head[0] - 0x40 in NODES else 0
    if head[0] - 0x40 not in NODES:
        return 0
    if head[1] == 0x02:
        return _block_length(head, 7)
    return _SHORTEST_REPLY if head[1:2] in (ACK, NAK) else 0


def _block_length(head: bytes, start: int) -> int:
    """Return the length of the block whose `aa` stands at `start`; 0 when `aa` is no number."""
    digits = head[start : start + 2]
    if len(digits) < 2:
        return start + 2
    return start + 4 + int(digits) if digits.isdigit() and digits != b"00" else 0


_ANSWERED, _ANSWERS = (Enquiry, Select), (Value, Ack, Nak)


def intent(request: Message) -> Intent:
    """Tell what a request is for; control word and reference are parameters, too, and EOT only ends an exchange."""
    if isinstance(request, Enquiry):
        return Intent(access="read")
    return Intent(access="write") if isinstance(request, Select) else Intent(commands=not isinstance(request, Eot))


def mismatch(request: Message, reply: Message) -> str:
    """Name the first field in which a sound reply does not belong to a request; nothing when it belongs.

    Sections 4, 6 and 17 of the specification: ADR is outside the BCC, and an ACK says only who sends it.
    """
    if not isinstance(request, _ANSWERED):
        return "kind"
    if not isinstance(reply, _ANSWERS) or reply.address != request.address:
        return "address"
    if isinstance(reply, Nak):
        return ""
    if isinstance(reply, Value) is not isinstance(request, Enquiry):
        return "kind"
    if isinstance(reply, Value):
        if reply.sys != request.sys:
            return "sys"
        if reply.dataset != request.dataset:
            return "dataset"
        if reply.parameter != request.parameter:
            return "parameter"
    return ""


def blind_spots(data: bytes, direction: Direction) -> frozenset[int]:
    """Return the positions where one wrong bit can go unnoticed: ADR, and all of an enquiry between EOT and ENQ."""
    if direction == "reply":
        return frozenset([0])
    if len(data) == 1:
        return frozenset()
    return frozenset([1]) if data[2:3] == STX else frozenset(range(1, len(data) - 1))


def titled_forms() -> dict[str, Form[Any]]:
    """Return the forms of all telegrams by the titles that people know them by."""
    return {
        "Enquiry": ENQUIRY,
        "Select": SELECT,
        "Value": VALUE,
        "ACK": ACKNOWLEDGE,
        "NAK": REFUSE,
        "EOT": CLOSE,
    }


def check_type(type: str) -> ValueType:
    """Return the type if the manual knows it. Raises UsageError."""
    if type not in ("", *VALUE_TYPES):
        raise UsageError(f"{type!r} is no VABus type; they are {', '.join(VALUE_TYPES)}")
    return type  # type: ignore[return-value]
