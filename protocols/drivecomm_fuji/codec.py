"""Codec of the telegrams: the form of each telegram, and the requests that a generation accepts.

Order of checks and reading of streams: section 13, point 20, of the specification.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.errors import TelegramError
from drivecomm.protocol.schema import Form, characters, filler, hex_number
from drivecomm_fuji import telegrams
from drivecomm_fuji.telegrams import COMMAND_REFUSED, LENGTHS, SOH, StandardFrame

if TYPE_CHECKING:
    from drivecomm.protocol import Direction, Message
    from drivecomm_fuji.generations import Generation

_SHORTEST = min(LENGTHS.values())
_COMMANDS = frozenset([b"", *(bytes([command]) for _, command in LENGTHS)])


class FujiCodec:
    """Codec of the telegrams.

    Decoding accepts the telegrams of all generations. So does encoding, unless a profile is given: then it accepts only
    those that inverters of this profile understand. number_check: whether function numbers beyond the profile's are
    refused.

    A NAK that refuses an unlisted command carries that command, so its length is unknown. In a stream it is assumed to
    have 16 bytes (section 2.6 of the specification); a single telegram with such a command is refused. Therefore
    `decode` accepts it only if `measure` has just seen it.
    """

    def __init__(self, profile: Generation | None = None, *, number_check: bool = True) -> None:
        self._profile = profile
        self._number_check = number_check
        made = telegrams.telegrams(profile.nak_filler if profile else "  ")
        self._decode, self._encode = made.decode, made.encode
        self._in_stream = b""

    def measure(self, head: bytes, direction: Direction) -> int:
        """Return the length of the telegram that begins with these bytes, see `Codec.measure`."""
        if not head:
            return _SHORTEST
        if head[:1] != SOH:
            return 0
        needed = 5
        if len(head) >= needed:
            needed = LENGTHS.get((direction, head[4])) or self._unlisted(head, direction)
        return needed if head.find(SOH, 1, needed) < 0 else 0

    def decode(self, data: bytes, direction: Direction) -> Message:
        """Return the content of one telegram.

        Checked in this order: SOH, command, length, ETX, sum, station, control character, function, byte 8, data; and
        finally that ignored bytes hold no SOH, at which a receiver starts again (specification, section 1).
        """
        if data[4:5] in _COMMANDS:
            decoded = self._decode(data, direction)
        elif direction == "reply" and data[:5] == self._in_stream:
            decoded = COMMAND_REFUSED.parse(data)
        else:
            raise TelegramError("field", f"{chr(data[4])!r} is not a command", field="command")
        if SOH in data[1:]:
            raise TelegramError("field", "SOH stands only in front of a telegram, not among its data", field="data")
        return decoded

    def encode(self, message: Any) -> bytes:
        """Return the bytes of one telegram. Raises TelegramError if the profile's inverters do not understand it."""
        data = self._encode(message)
        if message.kind == "request":
            self._check_request(message)
        return data

    def _unlisted(self, head: bytes, direction: Direction) -> int:
        """Return the length of a telegram with an unlisted command, 0 if it has none."""
        if direction == "request" or head[3:4] != telegrams.NAK:
            return 0
        self._in_stream = head[:5]
        return 16

    def _check_request(self, message: telegrams.Frame) -> None:
        profile, command, to_all = self._profile, message.command, message.address == telegrams.BROADCAST
        function = message.function if isinstance(message, StandardFrame) else None
        if command == "m" and message.data != 0:
            raise TelegramError("field", "the data of m are zero", field="data")
        if to_all and command in "ARghijk":
            raise TelegramError("field", f"{command} cannot go to all stations, which do not answer", field="address")
        if to_all and function and not (profile.takes_from_all(function) if profile else function[0] == "S"):
            raise TelegramError("field", f"{function} cannot be broadcast to all stations", field="function")
        if profile is not None and command not in profile.all_commands:
            raise TelegramError("field", f"{profile.title} has no command {command!r}", field="command")
        if profile is not None and function is not None:
            reason = profile.refusal_of(function, number_check=self._number_check)
            if reason:
                raise TelegramError("field", reason, field="function")


class FujiReceivingCodec(FujiCodec):
    """Codec of the telegrams as an inverter receives them, including requests with an unlisted command, to refuse them.

    Its NAKs repeat bytes 5 to 7 of the request, even if they are invalid.
    """

    def __init__(self, profile: Generation) -> None:
        super().__init__(profile, number_check=False)
        self.alike = ("fuji", profile.nak_filler)
        echo = "function" / characters(3, lowest=0, highest=0xFF, meaning="as in the request")
        code, space = "error_code" / hex_number(2), filler(profile.nak_filler.encode())
        self._echo = Form(
            StandardFrame, *telegrams.head(["nak"], "RWAE"), echo, telegrams.SPACE, space, code, *telegrams.TAIL
        )

    def encode(self, message: Any) -> bytes:
        """Return the bytes of one telegram."""
        refuses = isinstance(message, StandardFrame) and message.kind == "nak"
        return self._echo.build(message) if refuses else super().encode(message)

    def _unlisted(self, head: bytes, direction: Direction) -> int:
        """Return the length of a telegram with an unlisted command; ETX shows which of three request forms it has."""
        if direction == "reply":
            return super()._unlisted(head, direction)
        for length in (8, 12):
            if len(head) < length - 2:
                return length - 2
            if head[length - 3 : length - 2] == telegrams.ETX:
                return length
        return 16
