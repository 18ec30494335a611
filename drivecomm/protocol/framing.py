"""Framers: bytes go in as they arrive, telegrams and discarded bytes come out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, TypeAlias

from drivecomm.errors import TelegramError

if TYPE_CHECKING:
    from drivecomm.protocol.telegram import Direction, Message


class Codec(Protocol):
    """The functions for a protocol's telegrams that a framer and a link need.

    The same bytes always have the same meaning, and a message does not change, so no bytes are decoded twice. A codec
    may have an attribute `alike` with any hashable value: codecs with equal values decode the same bytes to the same
    result.
    """

    def measure(self, head: bytes, direction: Direction) -> int:
        """Return the length of the telegram that begins with these bytes.

        0: no telegram begins with these bytes. More than len(head): the bytes that the telegram needs, or that are
        needed to measure it. For an empty head: the length of the shortest telegram of this direction, so that a reader
        can wait for it.
        """

    def decode(self, data: bytes, direction: Direction) -> Message:
        """Return the content of exactly one telegram. Raises TelegramError."""

    def encode(self, message: Message) -> bytes:
        """Return the bytes of a telegram. Raises TelegramError for a field that does not fit."""


@dataclass(frozen=True, slots=True)
class Framed:
    """A sound telegram."""

    data: bytes
    message: Message


@dataclass(frozen=True, slots=True)
class Damaged:
    """Bytes that have the shape of a telegram but are not valid; all but the first byte are searched again."""

    data: bytes
    error: TelegramError


@dataclass(frozen=True, slots=True)
class Noise:
    """Bytes with which no telegram begins."""

    data: bytes


Find: TypeAlias = Framed | Damaged | Noise
"""Result of a framer for a part of its bytes."""

# Longer than any telegram, so that it can be measured; limits the copy that is made for each byte examined.
_HEAD = 512


class Framer:
    """Search for the telegrams of one direction in a stream of bytes.

    The result does not depend on the pieces in which the bytes are fed. A byte that cannot start a telegram is noise.
    If bytes that could have been a telegram are not valid, only the first of them is dropped, and the search continues
    with the next.
    """

    def __init__(self, codec: Codec, direction: Direction) -> None:
        self._codec = codec
        self._direction: Direction = direction
        self._pending = b""
        self._shortest = codec.measure(b"", direction) or 1
        self.missing = self._shortest
        """Number of bytes that a telegram still needs at least; the shortest length if none has begun."""

    @property
    def begun(self) -> bool:
        """Whether there are pending bytes that may be the beginning of a telegram."""
        return bool(self._pending)

    @property
    def held(self) -> int:
        """Number of pending bytes that may be the beginning of a telegram."""
        return len(self._pending)

    def feed(self, data: bytes) -> list[Find]:
        """Add bytes from the line and return the finds that are now certain, in order."""
        measured = 0
        if not self._pending and data:
            measured = self._codec.measure(data, self._direction)
            if measured == len(data) and isinstance(found := self._decoded(data), Framed):
                # The usual case: one whole telegram and nothing else.
                self.missing = self._shortest
                return [found]
        self._pending += data
        return self._search(final=False, measured=measured)

    def flush(self) -> list[Find]:
        """Return the finds in the pending bytes, once a gap shows that nothing follows them."""
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
                # Whole if these bytes only could have begun a longer telegram; cut off otherwise.
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
    """Return whether everything before some byte of a telegram is repeated from that byte on, as far as it fits.

    If a telegram breaks off and is sent again immediately, the two parts together can have the right length, and often
    the right BCC: anything that occurs twice cancels out of an exclusive-or. The words would be read from the second
    head. A valid telegram looks like this only if at least 24 bits match by chance.
    """
    # A repetition begins with the first three bytes.
    first = data.find(data[:3], 3)
    if first < 0:
        return False
    for start in range(first, len(data) - 2):
        repeated = min(start, len(data) - start)
        if data[start : start + repeated] == data[:repeated]:
            return True
    return False
