"""Responses of a unit to reads of its registers.

A read that includes a current value succeeds; a stale value in it is NaN, with its quality beside it. A read of values
only, none of them current, is refused: a master that ignores the quality must not take them as true.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

from drivecomm.errors import UsageError
from drivecomm.line import STATUS
from drivecomm.server.modbus_tcp.layout import (
    FAULT_AT,
    FIRST_QUANTITY,
    FIXED_END,
    FIXED_QUANTITIES,
    RAW_WORD_AT,
    STATE_AT,
    STATUS_AGE_AT,
    STATUS_QUALITY_AT,
    VALUE_WORDS,
    VERSION,
    VERSION_AT,
    OwnRegister,
    number_type,
)
from drivecomm.server.modbus_tcp.requests import ExceptionCode, RefusedRequest
from drivecomm.server.modbus_tcp.words import (
    NO_AGE,
    NOTHING,
    Quality,
    age_word,
    fault_word,
    number_words,
    quality_of,
    state_word,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivecomm.protocol import DriveStatus
    from drivecomm.server import CurrentValue, DriveSnapshot, ServedPlant
    from drivecomm.server.modbus_tcp.layout import NumberType

QualifiedWords: TypeAlias = tuple[Sequence[int], Quality | None]
"""Register words and their quality; None for data of the server itself."""

_KEPT_READS = 64
"""Number of register ranges per unit whose composition is cached."""


@dataclass(slots=True)
class _Moment:
    """State of a drive during one read."""

    plant: ServedPlant
    drive: DriveSnapshot
    now_s: float
    polled: frozenset[str] | None = None
    """Names of the polled parameters; None until looked up."""
    seen: tuple[CurrentValue | None, Quality, DriveStatus | None] | None = None
    """The status value, its quality and its content; None until looked up."""

    def value(self, name: str, number: NumberType) -> QualifiedWords:
        """Return the register words of a value, its quality and its age, together with the quality."""
        found = self.plant.value(self.drive.name, name)
        if found is None:
            quality = quality_of(None, self.now_s, polled=self._is_polled(name))
            return (*NOTHING[number], quality, NO_AGE), quality
        quality = quality_of(found, self.now_s, polled=True)
        if not quality.is_current or found.reading is None:
            return (*NOTHING[number], quality, NO_AGE), quality
        words = number_words(found.reading.value, number)
        if words is None:
            return (*NOTHING[number], Quality.UNAVAILABLE, NO_AGE), Quality.UNAVAILABLE
        return (*words, quality, age_word(found, self.now_s)), quality

    def status(self, address: int) -> QualifiedWords:
        """Return one of the status words that come before the values."""
        if self.seen is None:
            self.seen = self._status()
        found, quality, status = self.seen
        if address == STATUS_QUALITY_AT:
            return (quality,), None
        if address == STATUS_AGE_AT:
            return (age_word(found, self.now_s) if status else NO_AGE,), None
        if address == STATE_AT:
            return (state_word(self.drive, status),), quality
        if address == RAW_WORD_AT:
            return (status.word & 0xFFFF if status else 0,), quality
        return (fault_word(status),), quality

    def _is_polled(self, name: str) -> bool:
        if self.polled is None:
            self.polled = frozenset(each for group in self.drive.config.poll for each in group.parameters)
        return name in self.polled

    def _status(self) -> tuple[CurrentValue | None, Quality, DriveStatus | None]:
        found = self.plant.value(self.drive.name, STATUS)
        quality = quality_of(found, self.now_s, polled=True)
        status = self.drive.status if quality.is_current else None
        if status is None and quality.is_current:
            # The drive has fallen silent between the two lookups.
            quality = Quality.STALE
        return found, quality, status


_Tell: TypeAlias = Callable[[_Moment], QualifiedWords]


@dataclass(frozen=True, slots=True)
class _Block:
    """Registers that are read from one source. ends: offsets at which a partial read may begin or end."""

    first: int
    tell: _Tell
    ends: Sequence[int]


class UnitRegisters:
    """The readable registers of one drive, except those of commands."""

    def __init__(self, drive: str, own: Sequence[OwnRegister], plant: ServedPlant) -> None:
        self.drive = drive
        self._plant = plant
        self._blocks: dict[int, _Block] = {}
        self._known: dict[tuple[int, int], Sequence[_Tell]] = {}
        self._place(VERSION_AT, _constant(VERSION), (0, 1))
        for address in (STATE_AT, RAW_WORD_AT, FAULT_AT, STATUS_QUALITY_AT, STATUS_AGE_AT):
            self._place(address, _status_at(address), (0, 1))
        reserved = FIRST_QUANTITY - STATUS_AGE_AT - 1
        self._place(STATUS_AGE_AT + 1, _constant(*(0,) * reserved), range(reserved + 1))
        nothing = _constant(0, 0, Quality.UNAVAILABLE, NO_AGE)
        for address in range(FIRST_QUANTITY, FIXED_END, VALUE_WORDS):
            self._place(address, nothing, range(VALUE_WORDS + 1))
        values = [(address, name, number_type(name)) for address, name in FIXED_QUANTITIES]
        for address, name, number in [*values, *((each.address, each.name, each.type) for each in own)]:
            # Two reads of half a number each would combine halves of two different numbers.
            self._place(address, _value_of(name, number), (0, 2, 3, VALUE_WORDS))

    def _place(self, first: int, tell: _Tell, ends: Sequence[int]) -> None:
        block = _Block(first, tell, ends)
        self._blocks.update((first + offset, block) for offset in range(ends[-1]))

    def read(self, address: int, count: int) -> list[int]:
        """Return register words.

        Raises RefusedRequest for a missing register, for half a number, or if no value in the range is current.
        """
        moment = self._moment()
        words: list[int] = []
        qualities: list[Quality] = []
        for tell in self._tells(address, count):
            told, quality = tell(moment)
            words += told
            if quality is not None:
                qualities.append(quality)
        if qualities and not any(each.is_current for each in qualities):
            silent = any(each is not Quality.UNAVAILABLE for each in qualities)
            raise RefusedRequest(ExceptionCode.NO_RESPONSE if silent else ExceptionCode.NO_PATH)
        return words

    def _tells(self, address: int, count: int) -> Sequence[_Tell]:
        known = self._known.get((address, count))
        if known is None:
            known = tuple(self._parts(address, address + count))
            if len(self._known) < _KEPT_READS:
                self._known[address, count] = known
        return known

    def _parts(self, address: int, end: int) -> Iterator[_Tell]:
        while address < end:
            block = self._blocks.get(address)
            if block is None:
                raise RefusedRequest(ExceptionCode.ADDRESS)
            begin, last = address - block.first, min(end - block.first, block.ends[-1])
            if begin not in block.ends or last not in block.ends:
                raise RefusedRequest(ExceptionCode.ADDRESS)
            yield block.tell if (begin, last) == (0, block.ends[-1]) else _part_of(block.tell, begin, last)
            address = block.first + last

    def _moment(self) -> _Moment:
        try:
            state = self._plant.drive(self.drive)
        except UsageError:
            # The plant file was reloaded and no longer has this drive.
            raise RefusedRequest(ExceptionCode.NO_PATH) from None
        return _Moment(self._plant, state, time.time())


def _constant(*words: int) -> _Tell:
    return lambda _: (words, None)


def _status_at(address: int) -> _Tell:
    return lambda moment: moment.status(address)


def _value_of(name: str, number: NumberType) -> _Tell:
    return lambda moment: moment.value(name, number)


def _part_of(tell: _Tell, begin: int, end: int) -> _Tell:
    """Return a source for a part of a block; the quality counts only if the part includes the value."""

    def part(moment: _Moment) -> QualifiedWords:
        words, quality = tell(moment)
        return words[begin:end], None if begin else quality

    return part
