"""Telegrams to bytes and back: which form a telegram has, and what may be sent to whom.

Order of checks and reading of streams: section 13, point 20, of the specification.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.errors import TelegramError
from drivecomm.protocol.schema import Written
from drivecomm_fuji.telegrams import (
    BROADCAST,
    COMMAND_REFUSED,
    FORMS,
    LENGTHS,
    MESSAGES,
    NAK,
    REFUSALS,
    SHORTEST,
    SOH,
    FrameKind,
    Poll,
    Select,
    Standard,
)

if TYPE_CHECKING:
    from drivecomm.protocol import Direction, Message
    from drivecomm.protocol.schema import Form
    from drivecomm_fuji.generations import Profile


_DIRECTIONS: tuple[Direction, Direction] = ("request", "reply")
_LENGTHS: dict[Direction, dict[int, int]] = {
    direction: {ord(command): LENGTHS[direction, message] for command, message in MESSAGES.items()}
    for direction in _DIRECTIONS
}
_READS = frozenset("Rghijk")
_FRAMES = (Standard, Select, Poll)


class FujiCodec:
    """Telegrams to bytes and back.

    Decoding takes the telegrams of all generations. Encoding too, unless a profile is given: then only what its
    inverters understand. number_check: refuse function numbers beyond the profile's.

    A NAK that refuses a command which does not exist carries that command, and so has no length of its own. In a stream
    it is taken to have 16 bytes (section 2.6 of the specification); a single telegram with such a command is refused.
    So `decode` takes it only when `measure` has just met it.
    """

    def __init__(self, profile: Profile | None = None, *, number_check: bool = True) -> None:
        self._profile = profile
        self._number_check = number_check
        self._in_stream = b""
        self._known = None if profile is None else profile.all_commands
        self._written = Written(self._write)

    def measure(self, head: bytes, direction: Direction) -> int:
        """Return how long the telegram is that begins with these bytes, see `Codec.measure`."""
        if not head:
            return SHORTEST
        if head[:1] != SOH:
            return 0
        needed = 5
        if len(head) >= needed:
            needed = _LENGTHS[direction].get(head[4]) or self._unlisted(head, direction)
        return needed if head.find(SOH, 1, needed) < 0 else 0

    def decode(self, data: bytes, direction: Direction) -> Message:
        """Return the content of one telegram.

        Checked in this order: SOH, command, length, ETX, sum, station, control character, function, byte 8, data; and
        that what is not looked at holds no SOH, where a receiver starts anew (specification, section 1).
        """
        command = chr(data[4]) if len(data) > 4 else "R"
        form = FORMS.get((_kind(data[3:4], direction), command), COMMAND_REFUSED)
        if form is COMMAND_REFUSED and not (direction == "reply" and data[:5] == self._in_stream):
            raise TelegramError("field", f"{command!r} is no command", field="command")
        decoded: Message = form.parse(data)
        if SOH in data[1:]:
            raise TelegramError("field", "SOH stands only in front of a telegram, not among its data", field="data")
        return decoded

    def encode(self, message: Message) -> bytes:
        """Return the bytes of one telegram. Raises TelegramError for what the profile's inverters do not understand."""
        if not isinstance(message, _FRAMES):
            raise TelegramError("field", f"{type(message).__name__} is no telegram of this protocol")
        if message.kind == "request" and message.command in _READS:
            return self._written.telegram(message)
        return self._write(message)

    def _write(self, message: Any) -> bytes:
        form = self._form(message)
        if form.message is not type(message):
            raise TelegramError("field", f"{message.command!r} is no command of a {message.frame} frame", field="frame")
        for name in form.absent:
            if name != "frame" and getattr(message, name) is not None:
                raise TelegramError("field", f"a {message.kind} of {message.command!r} has no {name}", field=name)
        data = form.build(message)
        if message.kind == "request":
            self._check_request(message)
        return data

    def _form(self, message: Standard | Select | Poll) -> Form[Any]:
        named = message.kind, message.command
        if named not in FORMS:
            raise TelegramError("field", f"{message.command!r} is no command", field="command")
        refusals = REFUSALS[self._profile.nak_filler] if self._profile is not None else {}
        return refusals.get(named, FORMS[named])

    def _unlisted(self, head: bytes, direction: Direction) -> int:
        """Return the length of a telegram with a command that does not exist, 0 where it has none."""
        if direction == "request" or head[3:4] != NAK:
            return 0
        self._in_stream = head[:5]
        return 16

    def _check_request(self, message: Standard | Select | Poll) -> None:
        if message.command == "m" and message.data != 0:
            raise TelegramError("field", "the data of m are zero", field="data")
        if message.address == BROADCAST:
            self._check_broadcast(message)
        if self._profile is None:
            return
        if self._known is not None and message.command not in self._known:
            raise TelegramError("field", f"{self._profile.title} has no command {message.command!r}", field="command")
        if isinstance(message, Standard) and message.function is not None:
            reason = self._profile.refusal_of(message.function, number_check=self._number_check)
            if reason:
                raise TelegramError("field", reason, field="function")

    def _check_broadcast(self, message: Standard | Select | Poll) -> None:
        if message.command == "A" or message.command in "Rghijk":
            raise TelegramError(
                "field", f"{message.command} cannot go to all stations: nobody would answer", field="address"
            )
        if not isinstance(message, Standard) or message.command == "E":
            return
        function = str(message.function)
        if not (self._profile.takes_from_all(function) if self._profile else function[:1] == "S"):
            raise TelegramError("field", f"{function} cannot be written to all stations at once", field="function")


def _kind(control: bytes, direction: Direction) -> FrameKind:
    """Return the kind to read; a wrong control character is found after the sum, by the form."""
    if direction == "request":
        return "request"
    return "nak" if control == NAK else "ack"
