"""Who sent what in a capture that does not say it, as that of a tap: by the protocols, piece by piece.

Only what is certain is told. A telegram that reads as a request and as a reply is taken for a reply where it answers
the request before it and comes within its reply time; otherwise it is a request. What is no telegram stays unknown.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeAlias

from drivecomm.errors import TelegramError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivecomm.capture import Capture, Piece, Source
    from drivecomm.protocol import Codec, Direction, Message, Protocol

# A drive that is slower than its protocol's reply time may still be answering.
_SLOWER = 2.0
_SHORTEST_GAP_S = 0.05
# In the order in which they are tried where nothing was asked.
_DIRECTIONS: dict[Direction, Source] = {"request": "master", "reply": "drive"}


@dataclass(frozen=True, slots=True)
class _Reader:
    plugin: Protocol
    codec: Codec

    def read(self, data: bytes, direction: Direction) -> tuple[int, Message] | None:
        """Return the telegram that these bytes begin with, and its length."""
        length = self.codec.measure(data, direction)
        if not 0 < length <= len(data):
            return None
        try:
            return length, self.codec.decode(data[:length], direction)
        except TelegramError:
            return None


@dataclass(frozen=True, slots=True)
class _Asked:
    reader: _Reader
    message: Message
    data: bytes
    time_s: float

    def is_answered_by(self, message: Message, data: bytes, time_s: float) -> bool:
        """Whether this could be the reply to it."""
        plugin = self.reader.plugin
        in_time = time_s - self.time_s <= _SLOWER * plugin.facts.timing.reply_timeout_s + _SHORTEST_GAP_S
        return in_time and data != self.data and not plugin.mismatch(self.message, message)


_Found: TypeAlias = "tuple[int, Source, _Reader, Message]"


def telling_apart(capture: Capture, protocols: Sequence[Protocol]) -> Capture:
    """Return the capture with its unknown pieces cut into telegrams of these protocols, each with its source.

    Pieces whose source is known stay as they are.
    """
    readers = [_Reader(plugin, plugin.codec(plugin.options())) for plugin in protocols]
    lines = {piece.line: _Line(readers) for piece in capture.pieces}
    told: list[Piece] = []
    for piece in capture.pieces:
        told += lines[piece.line].feed(piece) if piece.source == "unknown" else [piece]
    for line in lines.values():
        told += line.flush()
    return replace(capture, pieces=sorted(told, key=lambda piece: piece.time_s))


class _Line:
    """One line of a capture, with the bytes that are not yet told apart."""

    def __init__(self, readers: Sequence[_Reader]) -> None:
        self._readers = readers
        self._gap_s = max([_SHORTEST_GAP_S, *(reader.plugin.facts.gap_s for reader in readers)])
        self._pending: list[Piece] = []
        self._asked: _Asked | None = None

    def feed(self, piece: Piece) -> list[Piece]:
        """Take a piece and return what is now certain."""
        told = []
        if self._pending and piece.time_s - self._pending[-1].time_s > self._gap_s:
            told = self.flush()
        self._pending.append(piece)
        return told + self._search(at_the_end=False)

    def flush(self) -> list[Piece]:
        """Return what is left, now that nothing belongs to it any more."""
        return self._search(at_the_end=True)

    def _search(self, *, at_the_end: bool) -> list[Piece]:
        told: list[Piece] = []
        while self._pending:
            data = b"".join(piece.data for piece in self._pending)
            if not at_the_end and self._awaits_more(data):
                break
            length, source = self._telegram(data, self._cut_short(data) if at_the_end else None)
            told.append(self._take(length, source))
        return _joined(told)

    def _awaits_more(self, data: bytes) -> bool:
        """Whether these bytes may be the beginning of a telegram that goes before all that they are now."""
        if self._asked is not None:
            # Its reply is looked for first, so a request in the same bytes has to wait.
            needed = self._asked.reader.codec.measure(data, "reply")
            if needed:
                return needed > len(data)
        if self._telegram_at(data) is not None:
            return False
        return any(
            reader.codec.measure(data, direction) > len(data) for reader in self._readers for direction in _DIRECTIONS
        )

    def _telegram(self, data: bytes, otherwise: _Found | None) -> tuple[int, Source]:
        """Return the telegram at the beginning and note down what was asked; a byte that begins none is unknown."""
        found = self._telegram_at(data) or otherwise
        if found is None:
            return 1, "unknown"
        length, source, reader, message = found
        if source == "master":
            self._asked = _Asked(reader, message, data[:length], self._time_s(length))
        elif self._asked is not None and self._asked.is_answered_by(message, data[:length], self._time_s(length)):
            self._asked = None
        return length, source

    def _telegram_at(self, data: bytes) -> _Found | None:
        asked = self._asked
        if asked is not None and (reply := asked.reader.read(data, "reply")) is not None:
            length, message = reply
            if asked.is_answered_by(message, data[:length], self._time_s(length)):
                return length, "drive", asked.reader, message
        for direction, source in _DIRECTIONS.items():
            for reader in self._readers:
                if (read := reader.read(data, direction)) is not None:
                    return read[0], source, reader, read[1]
        return None

    def _cut_short(self, data: bytes) -> _Found | None:
        """Return the telegram that these bytes are if nothing follows, though a longer one could begin with them."""
        for direction, source in _DIRECTIONS.items():
            for reader in self._readers:
                try:
                    return len(data), source, reader, reader.codec.decode(data, direction)
                except TelegramError:
                    continue
        return None

    def _time_s(self, length: int) -> float:
        """Return when so many of the pending bytes were there."""
        for piece in self._pending:
            length -= len(piece.data)
            if length <= 0:
                break
        return piece.time_s

    def _take(self, length: int, source: Source) -> Piece:
        """Cut so many bytes off what is pending."""
        time_s, data = self._time_s(length), b""
        first = self._pending[0]
        while length:
            piece = self._pending.pop(0)
            data += piece.data[:length]
            if len(piece.data) > length:
                self._pending.insert(0, replace(piece, data=piece.data[length:]))
            length = max(0, length - len(piece.data))
        return replace(first, time_s=time_s, data=data, source=source)


def _joined(told: list[Piece]) -> list[Piece]:
    """Return the pieces with unknown bytes that follow each other in one."""
    joined: list[Piece] = []
    for piece in told:
        before = joined[-1] if joined else None
        if before is not None and piece.source == before.source == "unknown":
            joined[-1] = replace(piece, data=before.data + piece.data)
        else:
            joined.append(piece)
    return joined
