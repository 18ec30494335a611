"""Codec for Modbus telegrams in RTU framing, matching of replies, and intents of requests."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.errors import TelegramError
from drivecomm.protocol import Intent, difference
from drivecomm.protocol.schema import crc16, message_of, wrong_field
from drivecomm_modbus import functions as fn
from drivecomm_modbus.messages import Reply, Request
from drivecomm_modbus.telegrams import ADDRESSES, BROADCAST, EVERY_ADDRESS, TITLES, identification_reply, titled_forms

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.protocol import Direction, Message
    from drivecomm.protocol.schema import Form

_SHORTEST = {"request": 4, "reply": 5}
_REQUEST_LENGTHS = {
    **dict.fromkeys((1, 2, 3, 4, 5, 6, 8), 8), 0x0B: 4, 0x11: 4, 0x2B: 7, 0x64: 6, 0x65: 10,
}  # fmt: skip
_REPLY_LENGTHS = {5: 8, 6: 8, 8: 8, 0x0B: 8, 0x0F: 8, 0x10: 8, 0x64: 8, 0x65: 10}
_BYTE_COUNT_AT = {"request": {0x0F: 6, 0x10: 6, 0x17: 10}, "reply": dict.fromkeys((1, 2, 3, 4, 0x11, 0x17), 2)}
_OBJECTS_AT = 8


class ModbusCodec:
    """Codec for Modbus telegrams. addresses: valid addresses of drives."""

    def __init__(self, addresses: range = ADDRESSES) -> None:
        self.alike = (type(self).__name__, addresses)
        self._addresses, self._forms = addresses, titled_forms(addresses)

    def measure(self, head: bytes, direction: Direction) -> int:
        """Return the length of the telegram that begins with these bytes, see `Codec.measure`."""
        if not head:
            return _SHORTEST[direction]
        if head[0] not in self._addresses and (direction == "reply" or head[0] != BROADCAST):
            return 0
        return length_of(head, direction) if len(head) > 1 else _SHORTEST[direction]

    def decode(self, data: bytes, direction: Direction) -> Message:
        """Return the content of one telegram. Raises TelegramError: length is checked first, then CRC, then fields."""
        if len(data) < 4:
            raise TelegramError("length", f"{len(data)} bytes are not a telegram; the shortest has 4")
        needed = length_of(data, direction)
        if needed and needed != len(data):
            raise TelegramError("length", f"{len(data)} bytes, and function {data[1]:02X} has {needed}")
        # The form of an identification depends on its length, so make it only for a sound telegram.
        if (not needed or data[1] == fn.IDENTIFICATION) and crc16(data[:-2]) != data[-2:]:
            raise TelegramError("checksum", f"CRC {data[-2:].hex(' ').upper()} is wrong")
        form = self._form_of(data[1], len(data) - _OBJECTS_AT - 2, direction) if needed else None
        if form is not None:
            message: Message = form.parse(data)
            return message
        raise wrong_field("function", f"{data[1]:02X} is unknown")

    def encode(self, message: Any) -> bytes:
        """Return the bytes of one telegram."""
        direction: Direction = "request" if isinstance(message, Request) else "reply"
        function, refused = message.function, direction == "reply" and message.exception is not None
        if type(function) is not int:
            raise wrong_field("function", f"{function!r} is not a number")
        texts = message.texts if direction == "reply" and isinstance(message.texts, tuple) else ()
        size = sum(2 + len(each) for each in texts if isinstance(each, str))
        form = self._form_of(function | refused << 7, size, direction)
        if form is None:
            raise wrong_field("function", f"{function} is unknown; with an exception, any can be refused")
        data = form.build(message)
        if len(data) > 256:
            raise TelegramError("length", f"{len(data)} bytes; a telegram has 256 at most")
        return data

    def content(self, data: bytes) -> bytes:
        """Return the address, function and data of one telegram."""
        return data[:-2]

    def transaction(self, _data: bytes) -> int | None:
        """Return the transaction number of a telegram, or None for a framing without one."""
        return None

    def _form_of(self, function: int, size: int, direction: Direction) -> Form[Any] | None:
        if function == fn.IDENTIFICATION and direction == "reply":
            return identification_reply(self._addresses, max(size, 0))
        return self._forms.get(TITLES[direction].get(function, ""))


class ModbusDriveCodec(ModbusCodec):
    """The telegrams as a drive on a two-wire line hears them: requests, and also the replies of other drives.

    No mark distinguishes requests from replies. Without this codec, the reply to a write would be mistaken for the
    beginning of a long request, and the next request would be lost in it.
    """

    def measure(self, head: bytes, direction: Direction) -> int:
        """Return the length of the telegram that begins with these bytes, see `Codec.measure`."""
        needed = super().measure(head, direction)
        if not needed and direction == "request" and head[0] in self._addresses and 0 < head[1] < 0x80:
            # An unknown function, to be refused: only the check shows where such a request ends.
            ends = (end for end in range(4, len(head) + 1) if crc16(head[: end - 2]) == head[end - 2 : end])
            return next(ends, len(head) + 1)
        if direction == "request" and needed and len(head) > _SHORTEST["request"]:
            reply = length_of(head, "reply")
            if 0 < reply <= len(head) and reply != needed and crc16(head[: reply - 2]) == head[reply - 2 : reply]:
                return reply
        return needed

    def decode(self, data: bytes, direction: Direction) -> Message:
        """Return the content of one telegram. Raises TelegramError."""
        try:
            return super().decode(data, direction)
        except TelegramError as error:
            if direction == "reply" or error.category != "length":
                raise
            return super().decode(data, "reply")


def length_of(head: bytes, direction: Direction) -> int:
    """Return the length of the telegram that begins with these bytes, at least two; 0 for an unknown function."""
    function = head[1]
    if direction == "reply" and function & 0x80:
        return 5 if function > 0x80 else 0
    place = _BYTE_COUNT_AT[direction].get(function)
    if place is not None:
        return place + 3 + head[place] if len(head) > place else place + 3
    if function == fn.IDENTIFICATION and direction == "reply":
        return _length_of_identification(head)
    return (_REQUEST_LENGTHS if direction == "request" else _REPLY_LENGTHS).get(function, 0)


def _length_of_identification(head: bytes) -> int:
    place = _OBJECTS_AT
    if len(head) < place:
        return place + 2
    for _ in range(head[place - 1]):
        if len(head) < place + 2:
            return place + 4
        place += 2 + head[place + 1]
    return place + 2


def message_from(given: Mapping[str, Any], direction: Direction) -> Message:
    """Return a message from fields with the names that test vectors use; the function determines the kind."""
    kind: type[Any] = Request if direction == "request" else Reply
    message: Message = message_of(kind, given, f"a {direction}")
    return message


def mismatch(request: Message, reply: Message) -> str:
    """Return the first field in which a sound reply does not belong to a request; empty if it belongs."""
    if not isinstance(request, Request) or not isinstance(reply, Reply):
        return "kind"
    if request.address == BROADCAST:
        return "broadcast"
    if differs := difference(request, reply, "address", "function"):
        return differs
    if reply.transaction is not None and reply.transaction != transaction_of(request):
        return "transaction"
    if reply.exception is not None:
        return ""
    # Bits are padded to whole bytes.
    step, count = 8 if request.function in (fn.READ_COILS, fn.READ_INPUTS) else 1, request.count or 0
    if reply.values is not None and len(reply.values) != -(-count // step) * step:
        return "byte_count"
    for name in ("start", "value", "count", "sub_function", "read_code"):
        asked, answered = getattr(request, name), getattr(reply, name)
        if name == "count" and request.values is not None:
            asked = len(request.values)
        only_asked = name == "value" and request.sub_function  # every sub-function but 0 has an answer of its own
        if answered is not None and asked is not None and asked != answered and not only_asked:
            return name
    return ""


def transaction_of(request: Request) -> int:
    """Return the transaction number of a request over TCP; without one, its CRC, which depends on its content."""
    if request.transaction is not None:
        return request.transaction
    return int.from_bytes(_EVERY.encode(request)[-2:], "big")


_EVERY = ModbusCodec(EVERY_ADDRESS)


def intent(message: Message) -> Intent:
    """Return the intent of a request; diagnostics except the echo can restart the communication or clear counters."""
    if not isinstance(message, Request):
        return Intent()
    if message.function in fn.READS:
        return Intent(access="read")
    if message.function in (*fn.BROADCASTS, fn.READ_WRITE):
        return Intent(access="write")
    return Intent(commands=message.function == fn.DIAGNOSTICS and message.sub_function != 0)
