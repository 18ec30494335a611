"""Framers: bytes in as they come, telegrams and discarded bytes out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, TypeAlias

from drivecomm.errors import TelegramError

if TYPE_CHECKING:
    from drivecomm.protocol.telegram import Direction, Message


class Codec(Protocol):
    """What a framer and a link need of a protocol's telegrams.

    The same bytes mean the same each time, and a message does not change: what was decoded once is not decoded again.
    It may have an attribute `alike`, any hashable value: codecs with equal ones make the same of the same bytes.
    """

    def measure(self, head: bytes, direction: Direction) -> int:
        """Return the length of the telegram that begins with these bytes.

        0: no telegram begins like this. More than len(head): that many bytes are needed, or needed to know more. For no
        bytes at all: the length of the shortest telegram of this direction, so that a reader can wait for it.
        """

    def decode(self, data: bytes, direction: Direction) -> Message:
        """Return the content of exactly one telegram. Raises TelegramError."""

    def encode(self, message: Message) -> bytes:
        """Return the telegram's bytes. Raises TelegramError for a field that does not fit."""


@dataclass(frozen=True, slots=True)
class Framed:
    """A sound telegram."""

    data: bytes
    message: Message


@dataclass(frozen=True, slots=True)
class Damaged:
    """Bytes with the shape of a telegram that are none; all but the first are looked at again."""

    data: bytes
    error: TelegramError


@dataclass(frozen=True, slots=True)
class Noise:
    """Bytes that begin no telegram."""

    data: bytes


Find: TypeAlias = Framed | Damaged | Noise
"""What a framer makes of bytes."""

# More than any telegram has: enough to be measured by, and all that is copied for each byte that is looked at.
_HEAD = 512


class Framer:
    """Finds telegrams of one direction in a stream of bytes.

    Feed it in any pieces: it finds the same telegrams. A byte that cannot start a telegram is noise; when the bytes
    that could have been a telegram are none, only the first of them is dropped and the search goes on behind it.
    """

    def __init__(self, codec: Codec, direction: Direction) -> None:
        self._codec = codec
        self._direction: Direction = direction
        self._pending = b""
        self._shortest = codec.measure(b"", direction) or 1
        self.missing = self._shortest
        """How many more bytes a telegram needs at least; those of the shortest when none has begun."""

    @property
    def begun(self) -> bool:
        """Whether there are bytes that may be the beginning of a telegram."""
        return bool(self._pending)

    @property
    def held(self) -> int:
        """How many bytes are kept that may be the beginning of a telegram."""
        return len(self._pending)

    def feed(self, data: bytes) -> list[Find]:
        """Take bytes from the line and return what is now certain, in order."""
        measured = 0
        if not self._pending and data:
            measured = self._codec.measure(data, self._direction)
            if measured == len(data) and isinstance(found := self._decoded(data), Framed):
                # One whole telegram and nothing else, as nearly always.
                self.missing = self._shortest
                return [found]
        self._pending += data
        return self._search(final=False, measured=measured)

    def flush(self) -> list[Find]:
        """Return what the pending bytes amount to, now that a gap says that nothing follows them."""
        return self._search(final=True)

    def _search(self, *, final: bool, measured: int = 0) -> list[Find]:
        pending, finds = self._pending, list[Find]()
        measure, direction = self._codec.measure, self._direction
        start = noise_from = 0
        self.missing = self._shortest
        while start < len(pending):
            left = len(pending) - start
            head = pending[start : start + _HEAD]
            needed, measured = measured or measure(head, direction), 0
            while needed > len(head) < left:
                head = pending[start : start + needed]
                needed = measure(head, direction)
            found: Find | None = None
            if needed > left:
                if not final:
                    self.missing = needed - left
                    break
                # Whole all the same if it only could have been the beginning of a longer one; cut off otherwise.
                found = self._decoded(pending[start:])
                if isinstance(found, Damaged) and left == 1:
                    found = None
            elif needed:
                found = self._decoded(pending[start : start + needed])
            if found is not None:
                if noise_from < start:
                    finds.append(Noise(pending[noise_from:start]))
                    noise_from = start
                finds.append(found)
            if isinstance(found, Framed):
                start += len(found.data)
                noise_from = start
            else:
                start += 1
        if noise_from < start:
            finds.append(Noise(pending[noise_from:start]))
        self._pending = pending[start:]
        return finds

    def _decoded(self, data: bytes) -> Framed | Damaged:
        try:
            return Framed(data, self._codec.decode(data, self._direction))
        except TelegramError as error:
            return Damaged(data, error)


def begins_again(data: bytes) -> bool:
    """Tell whether a telegram begins once more in its middle: all that came before, or as much as there is room for.

    A telegram that breaks off and is repeated at once gives one of the right length, and often of the right BCC: what
    stands in it twice cancels out of an exclusive-or, whatever it is. Its words would be read out of the second head. A
    drive that means such a telegram has to match at least 24 bits by chance.
    """
    # Any repetition that is looked for begins with the first three bytes.
    first = data.find(data[:3], 3)
    if first < 0:
        return False
    for start in range(first, len(data) - 2):
        repeated = min(start, len(data) - start)
        if data[start : start + repeated] == data[:repeated]:
            return True
    return False
