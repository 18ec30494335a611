"""Telegrams of older Huanyang drives in RTU mode (HY Series Inverter, User Manual of 27 June 2010, p. 61 to 64).

    address  function  LEN  data ...  CRC low  CRC high

They look like those of Modbus and have its check: CRC-16, polynomial A001H, start FFFFH, low byte first (p. 63). The
functions differ, and LEN counts the bytes of the data (p. 63). So every telegram has LEN + 5 bytes.

Facts that the manual omits come from programs in use: a read request has LEN 3 and a value of 0 (LinuxCNC hy_vfd,
FluidNC), the reply to a status request names its CFG (both; the manual's example on p. 62 does not), the reply to a
frequency repeats it (both). On p. 62 a status request has LEN 1 in the format and LEN 3 in the example; the same
example in Holip's HLP-C+ manual (p. 74) has the CRC of LEN 1. Some programs send LEN 3, with two more bytes.

Faults to expect: the reply to a write, to a frequency, to a control byte and to a read of 0 can equal the request byte
for byte, and so does the echo of a two-wire adapter; the reply to a control byte repeats nothing of its request.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from drivecomm.errors import TelegramError
from drivecomm.protocol import Intent, difference
from drivecomm.protocol.schema import CheckCharacters, Form, choice, crc16, message_of, unsigned, whole, wrong_field

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.protocol import Direction, Message

ADDRESSES = range(1, 251)
"""Values of PD163; 0 is a drive that does not communicate (p. 59)."""
BROADCAST = 0
READ, WRITE, CONTROL, STATUS, FREQUENCY = 0x01, 0x02, 0x03, 0x04, 0x05
REFUSED, CONTROL_REFUSED = 0x81, 0x83
"""Functions of a refusal: 81H for reads and writes repeats the PD, 83H for control data repeats the status (p. 62)."""

_KINDS = {
    READ: "read", WRITE: "write", CONTROL: "control", STATUS: "status", FREQUENCY: "frequency",
    REFUSED: "refused", CONTROL_REFUSED: "control_refused",
}  # fmt: skip
_REFUSALS = {READ: REFUSED, WRITE: REFUSED, CONTROL: CONTROL_REFUSED}
_SHORTEST, _AROUND_DATA = 6, 5
_LONGEST_DATA = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Telegram:
    """Fields of all telegrams. length: LEN. parameter: number of a PD, or CFG. value: a byte or a word."""

    address: int
    function: int
    length: int
    parameter: int | None = None
    value: int | None = None

    @property
    def kind(self) -> str:
        """The meaning of the function."""
        return _KINDS.get(self.function, "unknown")


@dataclass(frozen=True, slots=True, kw_only=True)
class Request(Telegram):
    """A telegram of the master."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Reply(Telegram):
    """A telegram of a drive. value: of control data, CNST."""


def _form(message: type[Any], function: int, length: int) -> Form[Any]:
    is_named = function not in (CONTROL, CONTROL_REFUSED, FREQUENCY)
    items = {STATUS: whole(1, range(8), "CFG: which status value")}
    named = ["parameter" / items.get(function, unsigned(1, "PD number"))] if is_named else []
    size = length - len(named)
    meaning = {CONTROL: "CNTR" if message is Request else "CNST", CONTROL_REFUSED: "CNST", FREQUENCY: "0.01 Hz"}
    valued = ["value" / unsigned(size, meaning.get(function, "value"))] if size else []

    def check(given: Telegram) -> None:
        if given.address == BROADCAST and function not in (WRITE, CONTROL):
            raise wrong_field("address", "all drives take writes and control data only")

    return Form(
        message,
        "address" / whole(1, range(251) if message is Request else ADDRESSES, "address; 0 in a request: all drives"),
        "function" / choice({bytes([function]): function}, f"{function:02X}: {_KINDS[function]}"),
        "length" / choice({bytes([length]): length}, "LEN: bytes of data"),
        *named,
        *valued,
        CheckCharacters(2, 0, crc16, meaning="CRC of all bytes before it, low byte first"),
        check=check,
    )


_REQUESTS = ((READ, 3), (READ, 1), (WRITE, 3), (WRITE, 2), (CONTROL, 1), (STATUS, 1), (STATUS, 3), (FREQUENCY, 2))
_REPLIES = (
    (READ, 3), (READ, 2), (WRITE, 3), (WRITE, 2), (CONTROL, 1), (STATUS, 3), (FREQUENCY, 2),
    (REFUSED, 1), (CONTROL_REFUSED, 1),
)  # fmt: skip
_FORMS: dict[Direction, dict[tuple[int, int], Form[Any]]] = {
    "request": {each: _form(Request, *each) for each in _REQUESTS},
    "reply": {each: _form(Reply, *each) for each in _REPLIES},
}


def titled_forms() -> dict[str, Form[Any]]:
    """Return the forms of all telegrams by title."""
    return {
        f"{_KINDS[function].replace('_', ' ').capitalize()}, LEN {length}{'' if who == 'request' else ', drive'}": form
        for who, forms in _FORMS.items()
        for (function, length), form in forms.items()
    }


class HuanyangCodec:
    """Codec of the telegrams."""

    alike = "huanyang"

    def measure(self, head: bytes, direction: Direction) -> int:
        """Return the length of the telegram that begins with these bytes, see `Codec.measure`.

        A drive also hears the replies of others; they have the same lengths.
        """
        if head and head[0] not in ADDRESSES and (direction == "reply" or head[0] != BROADCAST):
            return 0
        return _SHORTEST if len(head) < 2 else _length_of(head)

    def decode(self, data: bytes, direction: Direction) -> Message:
        """Return the content of one telegram. Raises TelegramError: length is checked first, then CRC, then fields."""
        needed = _length_of(data) if len(data) >= _SHORTEST else _SHORTEST
        if needed != len(data) and (needed or len(data) < _SHORTEST):
            raise TelegramError("length", f"{len(data)} bytes are not a telegram; {needed} would be one")
        form = _FORMS[direction].get((data[1], data[2]))
        if form is not None:
            message: Message = form.parse(data)
            return message
        if crc16(data[:-2]) != data[-2:]:
            raise TelegramError("checksum", f"CRC {data[-2:].hex(' ').upper()} is wrong")
        raise wrong_field("function", f"{data[1]:02X} with LEN {data[2]} is unknown")

    def encode(self, message: Any) -> bytes:
        """Return the bytes of one telegram."""
        form = _FORMS["request" if isinstance(message, Request) else "reply"].get((message.function, message.length))
        if form is None:
            raise wrong_field("function", f"{message.function!r} with LEN {message.length!r} is unknown")
        return form.build(message)


def _length_of(head: bytes) -> int:
    """Return the length of the telegram that begins with these bytes, at least two; 0 if the beginning is invalid."""
    if head[1] not in _KINDS:
        return 0
    if len(head) == 2:
        return _SHORTEST
    return head[2] + _AROUND_DATA if 1 <= head[2] <= _LONGEST_DATA else 0


def message_from(given: Mapping[str, Any], direction: Direction) -> Message:
    """Return a message from fields with the names that test vectors use."""
    kind: type[Any] = Request if direction == "request" else Reply
    message: Message = message_of(kind, given, f"a {direction}")
    return message


def mismatch(request: Message, reply: Message) -> str:
    """Return the first field in which a sound reply does not belong to a request; empty if it belongs."""
    if not isinstance(request, Request) or not isinstance(reply, Reply):
        return "kind"
    if request.address == BROADCAST:
        return "broadcast"
    if differs := difference(request, reply, "address"):
        return differs
    refused = reply.function == _REFUSALS.get(request.function)
    if not refused and reply.function != request.function:
        return "function"
    if request.parameter != reply.parameter:
        return "parameter"
    repeats = request.function in (WRITE, FREQUENCY) and not refused
    return "value" if repeats and request.value != reply.value else ""


def intent(message: Message) -> Intent:
    """Return the intent of a request."""
    if not isinstance(message, Request):
        return Intent()
    if message.function == CONTROL:
        return Intent(commands=True)
    return Intent(access="write" if message.function in (WRITE, FREQUENCY) else "read")
