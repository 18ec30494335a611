"""Framers: bytes in as they come, telegrams and discarded bytes out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, TypeAlias

from drivecomm.errors import TelegramError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivecomm.telegram import Direction, Message


class Codec(Protocol):
    """What a framer and a link need of a protocol's telegrams."""

    def measure(self, head: bytes, direction: Direction) -> int:
        """Return the length of the telegram that begins with these bytes.

        0: no telegram begins like this. More than len(head): that many bytes are needed, or needed to know more.
        """
        ...

    def decode(self, data: bytes, direction: Direction) -> Message:
        """Return the content of exactly one telegram. Raises TelegramError."""
        ...

    def encode(self, message: Message) -> bytes:
        """Return the telegram's bytes. Raises TelegramError for a field that does not fit."""
        ...


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


class Framer:
    """Finds telegrams of one direction in a stream of bytes.

    Feed it in any pieces: it finds the same telegrams. A byte that cannot start a telegram is noise; when the bytes
    that could have been a telegram are none, only the first of them is dropped and the search goes on behind it.
    """

    def __init__(self, codec: Codec, direction: Direction) -> None:
        self._codec = codec
        self._direction: Direction = direction
        self._pending = b""
        self.missing = 1
        """How many bytes must come at least before there can be a further find."""

    @property
    def empty(self) -> bool:
        """Whether no bytes are kept that could be the beginning of a telegram."""
        return not self._pending

    def feed(self, data: bytes) -> list[Find]:
        """Take bytes from the line and return what is now certain, in order."""
        self._pending += data
        return list(self._search(final=False))

    def flush(self) -> list[Find]:
        """Return what the pending bytes amount to, now that a gap says that nothing follows them."""
        return list(self._search(final=True))

    def _search(self, *, final: bool) -> Iterator[Find]:
        noise = b""
        while self._pending:
            needed = self._codec.measure(self._pending, self._direction)
            if needed > len(self._pending):
                if not final:
                    break
                # Whole all the same if it only could have been the beginning of a longer one; cut off otherwise.
                found: Find | None = self._read(self._pending)
                if isinstance(found, Damaged) and len(self._pending) == 1:
                    found = None
            else:
                found = self._read(self._pending[:needed]) if needed else None
            if noise and found is not None:
                yield Noise(noise)
                noise = b""
            if found is not None:
                yield found
            if isinstance(found, Framed):
                self._pending = self._pending[len(found.data) :]
            else:
                noise += self._pending[:1]
                self._pending = self._pending[1:]
        self.missing = self._codec.measure(self._pending, self._direction) - len(self._pending) if self._pending else 1
        if noise:
            yield Noise(noise)

    def _read(self, data: bytes) -> Framed | Damaged:
        try:
            return Framed(data, self._codec.decode(data, self._direction))
        except TelegramError as error:
            return Damaged(data, error)
