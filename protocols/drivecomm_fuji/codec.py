"""Telegrams to bytes and back: which form a telegram has, and what may be sent to whom.

Order of checks and reading of streams: section 13, point 20, of the specification.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.errors import TelegramError
from drivecomm.protocol.schema import Form, characters, filler, hex_number
from drivecomm_fuji import telegrams
from drivecomm_fuji.telegrams import FORMS, SOH, Frame, Standard

if TYPE_CHECKING:
    from drivecomm.protocol import Direction, Message
    from drivecomm_fuji.generations import Profile

_LENGTHS = {
    ("request" if kind == "request" else "reply", ord(letter)): form.size for (kind, letter), form in FORMS.items()
}
_SHORTEST = min(_LENGTHS.values())


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

    def measure(self, head: bytes, direction: Direction) -> int:
        """Return how long the telegram is that begins with these bytes, see `Codec.measure`."""
        if not head:
            return _SHORTEST
        if head[:1] != SOH:
            return 0
        needed = 5
        if len(head) >= needed:
            needed = _LENGTHS.get((direction, head[4])) or self._unlisted(head, direction)
        return needed if head.find(SOH, 1, needed) < 0 else 0

    def decode(self, data: bytes, direction: Direction) -> Message:
        """Return the content of one telegram.

        Checked in this order: SOH, command, length, ETX, sum, station, control character, function, byte 8, data; and
        that what is not looked at holds no SOH, where a receiver starts anew (specification, section 1).
        """
        command = chr(data[4]) if len(data) > 4 else "R"
        # A wrong control character is found after the sum, by the form.
        kind = "request" if direction == "request" else "nak" if data[3:4] == telegrams.NAK else "ack"
        form = FORMS.get((kind, command), telegrams.COMMAND_REFUSED)
        if form is telegrams.COMMAND_REFUSED and not (direction == "reply" and data[:5] == self._in_stream):
            raise TelegramError("field", f"{command!r} is no command", field="command")
        decoded: Message = form.parse(data)
        if SOH in data[1:]:
            raise TelegramError("field", "SOH stands only in front of a telegram, not among its data", field="data")
        return decoded

    def encode(self, message: Any) -> bytes:
        """Return the bytes of one telegram. Raises TelegramError for what the profile's inverters do not understand."""
        if not isinstance(message, Frame):
            raise TelegramError("field", f"{type(message).__name__} is no telegram of this protocol")
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

    def _form(self, message: Frame) -> Form[Any]:
        named = message.kind, message.command
        if named not in FORMS:
            raise TelegramError("field", f"{message.command!r} is no command", field="command")
        refusals = telegrams.REFUSALS[self._profile.nak_filler] if self._profile is not None else {}
        return refusals.get(named, FORMS[named])

    def _unlisted(self, head: bytes, direction: Direction) -> int:
        """Return the length of a telegram with a command that does not exist, 0 where it has none."""
        if direction == "request" or head[3:4] != telegrams.NAK:
            return 0
        self._in_stream = head[:5]
        return 16

    def _check_request(self, message: Frame) -> None:
        profile, command, to_all = self._profile, message.command, message.address == telegrams.BROADCAST
        function = message.function if isinstance(message, Standard) else None
        if command == "m" and message.data != 0:
            raise TelegramError("field", "the data of m are zero", field="data")
        if to_all and command in "ARghijk":
            raise TelegramError("field", f"{command} cannot go to all stations: nobody would answer", field="address")
        if to_all and function and not (profile.takes_from_all(function) if profile else function[0] == "S"):
            raise TelegramError("field", f"{function} cannot be written to all stations at once", field="function")
        if profile is not None and command not in profile.all_commands:
            raise TelegramError("field", f"{profile.title} has no command {command!r}", field="command")
        if profile is not None and function is not None:
            reason = profile.refusal_of(function, number_check=self._number_check)
            if reason:
                raise TelegramError("field", reason, field="function")


class Ear(FujiCodec):
    """The telegrams as an inverter hears them: also requests with a command that does not exist, to refuse them.

    Its NAKs repeat bytes 5 to 7 of the request, whatever they are.
    """

    def __init__(self, profile: Profile) -> None:
        super().__init__(profile, number_check=False)
        self.alike = ("fuji", profile.nak_filler)
        echo = "function" / characters(3, lowest=0, highest=0xFF, meaning="as in the request")
        code, space = "error_code" / hex_number(2), filler(profile.nak_filler.encode())
        self._echo = Form(
            Standard, *telegrams.head(["nak"], "RWAE"), echo, telegrams.SPACE, space, code, *telegrams.TAIL
        )

    def _form(self, message: Frame) -> Form[Any]:
        return self._echo if isinstance(message, Standard) and message.kind == "nak" else super()._form(message)

    def _unlisted(self, head: bytes, direction: Direction) -> int:
        """The ETX shows which of the three forms of request it has."""
        if direction == "reply":
            return super()._unlisted(head, direction)
        for length in (8, 12):
            if len(head) < length - 2:
                return length - 2
            if head[length - 3 : length - 2] == telegrams.ETX:
                return length
        return 16
