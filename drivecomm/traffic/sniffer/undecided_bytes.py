"""Undecided bytes of a line, each with its time and its sender."""

from __future__ import annotations

from bisect import bisect_right
from math import inf
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from drivecomm.capture import Piece, Source
    from drivecomm.protocol import LineSettings

# For a line with unknown settings: the time of a character at 9600 baud.
_UNKNOWN_CHARACTER_S = 10 / 9600


class _Part(NamedTuple):
    """A piece with its positions, which count from the first byte ever received. silence_s: silence before it."""

    start: int
    end: int
    time_s: float
    character_s: float
    silence_s: float
    source: Source

    def end_of(self, place: int) -> float:
        return self.time_s - (self.end - place - 1) * self.character_s


class UndecidedBytes:
    """The bytes behind the last decided one. Positions count from the first byte that is still stored.

    character_s: seconds per character for pieces without settings; None if unknown.

    A line without pauses may deliver pieces of one byte, so no method iterates over all pieces.
    """

    def __init__(self, character_s: float | None = None) -> None:
        self.data = b""
        self.character_s = character_s or _UNKNOWN_CHARACTER_S
        self._settings: LineSettings | None = None
        self._settings_character_s = 0.0
        self._dropped = 0
        self._parts: list[_Part] = []
        self._starts: list[int] = []
        self._pauses: dict[float, list[int]] = {}
        self._last_s = 0.0

    def __len__(self) -> int:
        return len(self.data)

    def append(self, piece: Piece) -> None:
        """Append a piece, which must be later than all before."""
        character_s = self._character_s_of(piece)
        start = self._dropped + len(self.data)
        self.data += piece.data
        silence_s = max(0.0, piece.time_s - len(piece.data) * character_s - self._last_s)
        self._parts.append(_Part(start, start + len(piece.data), piece.time_s, character_s, silence_s, piece.source))
        self._starts.append(start)
        for gap_s, pauses in self._pauses.items():
            if silence_s > gap_s:
                pauses.append(start)
        self._last_s = max(self._last_s, piece.time_s)

    def pass_by(self, piece: Piece) -> None:
        """Count a piece without storing it; no undecided bytes may be stored."""
        self._dropped += len(piece.data)
        self._last_s = max(self._last_s, piece.time_s)

    def times_of(self, piece: Piece) -> tuple[float, float, float]:
        """Return the start, the end and the silence before a piece that comes next, in seconds."""
        character_s = self._character_s_of(piece)
        time_s, length = piece.time_s, len(piece.data)
        silence_s = time_s - length * character_s - self._last_s
        return time_s - (length - 1) * character_s - character_s, time_s, silence_s if silence_s > 0 else 0.0

    def drop(self, number: int) -> None:
        """Remove this number of bytes from the beginning."""
        self._dropped += number
        if number == len(self.data):
            self.data = b""
            self._parts.clear()
            self._starts.clear()
            for pauses in self._pauses.values():
                pauses.clear()
            return
        self.data = self.data[number:]
        if gone := self._number_of(0):
            del self._parts[:gone], self._starts[:gone]
            for pauses in self._pauses.values():
                del pauses[: bisect_right(pauses, self._dropped - 1)]

    def silence_before(self, place: int) -> float:
        """Return the seconds of silence before a byte; 0 inside a piece, and after the last byte."""
        if place >= len(self.data):
            return 0.0
        part = self._part(place)
        return part.silence_s if part.start == self._dropped + place else 0.0

    def silence_after(self, now: float) -> float:
        """Return the seconds since the last byte."""
        return now - self._last_s

    def unbroken_until(self, place: int, gap_s: float) -> int:
        """Return the position of the first pause longer than `gap_s` behind this position; the end if there is none."""
        if len(self._parts) == 1:
            return len(self.data)
        pauses = self._pauses.get(gap_s)
        if pauses is None:
            pauses = self._pauses[gap_s] = [part.start for part in self._parts if part.silence_s > gap_s]
        next_one = bisect_right(pauses, self._dropped + place)
        return pauses[next_one] - self._dropped if next_one < len(pauses) else len(self.data)

    def quiet_s(self, place: int) -> float:
        """Return the silence that shows the end of a telegram, one and a half characters, in seconds."""
        return 1.5 * self._part(place).character_s

    def ended_s(self, place: int) -> float:
        """Return the time at which this byte ended."""
        return self._part(place).end_of(self._dropped + place)

    def began_s(self, place: int) -> float:
        """Return the time at which this byte began."""
        part = self._part(place)
        return part.end_of(self._dropped + place) - part.character_s

    def source_of(self, start: int, end: int) -> Source | None:
        """Return the sender of these bytes; None if there was more than one."""
        first, last = self._number_of(start), self._number_of(end - 1)
        source = self._parts[first].source
        for part in self._parts[first + 1 : last + 1]:
            if part.source != source:
                return None
        return source

    def _character_s_of(self, piece: Piece) -> float:
        settings = piece.settings
        if settings is None:
            return self.character_s
        if settings is not self._settings:
            self._settings, self._settings_character_s = settings, settings.character_s
        return self._settings_character_s

    def _part(self, place: int) -> _Part:
        if not self._parts:
            return _Part(0, 0, self._last_s, self.character_s, inf, "unknown")
        return self._parts[self._number_of(place)]

    def _number_of(self, place: int) -> int:
        starts = self._starts
        return bisect_right(starts, self._dropped + place, 1) - 1 if len(starts) > 1 else 0
