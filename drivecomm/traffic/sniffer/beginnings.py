"""Telegrams that can begin with given bytes, cached for each beginning and independent of earlier traffic."""

from __future__ import annotations

import re
from functools import cached_property
from typing import TYPE_CHECKING

from drivecomm.traffic.sniffer.readings import SHORTEST_LONG, TelegramReading, UnfinishedTelegram

if TYPE_CHECKING:
    from collections.abc import Iterable

    from drivecomm.traffic.sniffer.readings import TelegramReader


class Beginnings:
    """A cache of the ways in which telegrams can begin. readers: of all protocols to look for."""

    def __init__(self, readers: Iterable[TelegramReader]) -> None:
        self._readers = tuple(readers)
        self._by_first_byte: dict[int, list[TelegramReader]] = {}
        self._by_first_pair: dict[bytes, list[TelegramReader]] = {}
        self._goes_on: dict[bytes, bool] = {}
        self._ends_with: dict[int, bool] = {}

    def of(self, byte: int) -> list[TelegramReader]:
        """Return the readers for which a telegram can begin with this byte."""
        found = self._by_first_byte.get(byte)
        if found is None:
            found = self._by_first_byte[byte] = [reader for reader in self._readers if reader.begins_with(byte)]
        return found

    def of_pair(self, pair: bytes) -> list[TelegramReader]:
        """Return the readers for which a telegram that begins with these two characters is longer than two.

        At the end of the data, `pair` holds a single character; the telegram must then be longer than one.
        """
        found = self._by_first_pair.get(pair)
        if found is None:
            found = [reader for reader in self.of(pair[0]) if reader.goes_beyond(pair)]
            self._by_first_pair[pair] = found
        return found

    @cached_property
    def _pattern(self) -> re.Pattern[bytes]:
        """The bytes with which a telegram can begin."""
        found = bytes(byte for byte in range(256) if self.of(byte))
        return re.compile(b"[" + re.escape(found) + b"]" if found else b"(?!)")

    def next_place(self, data: bytes, place: int, end: int) -> int:
        """Return the next position at which more than a few characters can begin a telegram; `end` if there is none."""
        search = self._pattern.search
        while match := search(data, place, end):
            place = match.start()
            if self.of_pair(data[place : place + 2]):
                return place
            place += 1
        return end

    def sound_inside(self, data: bytes) -> bool:
        """Whether a sound telegram of more than a few bytes begins behind the first byte."""
        last = len(data) - SHORTEST_LONG + 1
        place = self.next_place(data, 1, last)
        while place < last:
            for reader in self.of_pair(data[place : place + 2]):
                look = reader.look(data, place, len(data))
                if type(look) is TelegramReading and not look.short:
                    return True
            place = self.next_place(data, place + 1, last)
        return False

    def may_go_on(self, character: bytes) -> bool:
        """Whether a single character is undecided until more bytes or silence follow."""
        if character not in self._goes_on:
            looks = [reader.look(character, 0, 1) for reader in self.of(character[0])]
            self._goes_on[character] = any(type(look) is UnfinishedTelegram for look in looks)
        return self._goes_on[character]

    def whole(self, data: bytes) -> tuple[TelegramReading, ...]:
        """Return the readings of bytes that are certainly one whole telegram of one protocol; empty for any others."""
        looks = [reader.look(data, 0, len(data)) for reader in self.of(data[0])]
        readings = tuple(look for look in looks if isinstance(look, TelegramReading) and not look.short)
        if not readings or self.sound_inside(data):
            return ()
        name, directions = readings[0].protocol.name, {reading.direction for reading in readings}
        plain = len(directions) == len(readings) and all(
            reading.end == len(data) and reading.protocol.name == name for reading in readings
        )
        return readings if plain else ()

    def ends_with(self, byte: int) -> bool:
        """Whether all telegrams that can begin with this byte end with it."""
        if byte not in self._ends_with:
            self._ends_with[byte] = all(reader.ends_with_first(byte) for reader in self.of(byte))
        return self._ends_with[byte]

    def whole_reply(self, name: str, data: bytes) -> tuple[TelegramReading, ...]:
        """Return these bytes as one whole reply in this protocol; empty if they may be or contain any other telegram.

        A request of exactly the same bytes does not count as another telegram.
        """
        found: TelegramReading | None = None
        for reader in self.of(data[0]):
            if reader.protocol.name == name and reader.direction == "request":
                if not reader.fits(data):
                    return ()
            elif type(look := reader.look(data, 0, len(data))) is TelegramReading and not look.short:
                if found or look.end != len(data) or look.protocol.name != name:
                    return ()
                found = look
        return (found,) if found and not self.sound_inside(data) else ()

    def single(self, data: bytes) -> tuple[list[TelegramReading], frozenset[str]]:
        """Return the readings of the first of these bytes alone, or nothing if longer readings exist.

        The second value names the protocols in which all these bytes may be the beginning of one long telegram.
        """
        looks = [(reader.protocol.name, reader.look(data, 0, len(data))) for reader in self.of(data[0])]
        readings = [look for _, look in looks if type(look) is TelegramReading]
        unfinished = frozenset(name for name, look in looks if type(look) is UnfinishedTelegram)
        return ([] if any(reading.end != 1 for reading in readings) else readings), unfinished
