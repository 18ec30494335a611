"""What the bytes at one place of a stretch can be, asked of the protocols' own codecs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

from drivecomm.errors import TelegramError

if TYPE_CHECKING:
    from drivecomm.framing import Codec
    from drivecomm.line import Parity
    from drivecomm.protocol import Protocol
    from drivecomm.telegram import Direction, Message

# More than any telegram has, see drivecomm.framing.
_HEAD = 512
# Bytes that say so little are a telegram only where one is due.
_SHORT = 4


@dataclass(frozen=True, slots=True)
class Reading:
    """A sound telegram from `start` up to `end`. data: without the parity bits, where the line has seven data bits."""

    start: int
    end: int
    protocol: Protocol
    direction: Direction
    data: bytes
    message: Message

    @property
    def short(self) -> bool:
        """Whether it could easily be chance."""
        return self.end - self.start < _SHORT


@dataclass(frozen=True, slots=True)
class Broken:
    """Bytes with the shape of a telegram that are none."""

    start: int
    end: int
    protocol: Protocol
    direction: Direction
    error: TelegramError


@dataclass(frozen=True, slots=True)
class Unfinished:
    """What may become a telegram when more bytes come."""

    needed: int


Look: TypeAlias = Reading | Broken | Unfinished | None


class Reader:
    """Reads telegrams of one protocol in one direction."""

    def __init__(self, protocol: Protocol, codec: Codec, direction: Direction) -> None:
        self.protocol = protocol
        self.direction: Direction = direction
        self.gap_s = protocol.facts.gap_s
        self._codec = codec

    def begins_with(self, byte: int) -> bool:
        """Whether a telegram can begin with this byte."""
        return self._codec.measure(bytes([byte]), self.direction) != 0

    def look(self, data: bytes, start: int, limit: int) -> Look:
        """Return what begins at `start` when nothing from `limit` on can belong to it, but more may come there."""
        head = data[start : min(limit, start + _HEAD)]
        needed = self._codec.measure(head, self.direction)
        if not needed:
            return None
        if needed > limit - start:
            return Unfinished(needed)
        return self._read(data, start, start + needed)

    def look_at_rest(self, data: bytes, start: int, limit: int) -> Look:
        """Return what begins at `start` when nothing comes behind `limit`: a whole telegram or a broken one."""
        found = self.look(data, start, limit)
        return self._read(data, start, limit) if isinstance(found, Unfinished) else found

    def _read(self, data: bytes, start: int, end: int) -> Reading | Broken:
        taken = data[start:end]
        try:
            message = self._codec.decode(taken, self.direction)
        except TelegramError as error:
            return Broken(start, end, self.protocol, self.direction, error)
        return Reading(start, end, self.protocol, self.direction, taken, message)


class SevenBitReader(Reader):
    """Reads telegrams of seven data bits whose parity bits came as the eighth, as a listener set to 8N1 hears them."""

    def __init__(self, protocol: Protocol, codec: Codec, direction: Direction, parity: Parity) -> None:
        super().__init__(protocol, codec, direction)
        self._with_parity = [byte | _parity_bit(byte, parity) for byte in range(128)]
        self._plain = bytes(byte & 0x7F for byte in range(256))

    def begins_with(self, byte: int) -> bool:
        """Whether a telegram can begin with this byte."""
        return self._with_parity[byte & 0x7F] == byte and super().begins_with(byte & 0x7F)

    def look(self, data: bytes, start: int, limit: int) -> Look:
        """As `Reader.look`; a wrong parity bit ends the telegram."""
        right = start
        while right < min(limit, start + _HEAD) and self._with_parity[data[right] & 0x7F] == data[right]:
            right += 1
        plain = data.translate(self._plain)
        found = super().look(plain, start, right)
        return self._read(plain, start, right) if isinstance(found, Unfinished) and right < limit else found

    def look_at_rest(self, data: bytes, start: int, limit: int) -> Look:
        """As `Reader.look_at_rest`."""
        found = self.look(data, start, limit)
        return self._read(data.translate(self._plain), start, limit) if isinstance(found, Unfinished) else found


def _parity_bit(byte: int, parity: Parity) -> int:
    odd = byte.bit_count() % 2
    return 0x80 * {"E": odd, "O": 1 - odd, "M": 1, "S": 0, "N": 0}[parity]
