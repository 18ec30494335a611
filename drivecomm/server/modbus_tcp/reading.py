"""What a unit answers to a read of its registers.

A read that holds something current is answered, and what is not current in it is NaN beside its quality. A read of
nothing but values of which none is current is refused: a master that looks at no quality must not take them for true.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeAlias

from drivecomm.errors import UsageError
from drivecomm.polling import STATUS
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
    from drivecomm.protocol import DriveStatus
    from drivecomm.server import CurrentValue, DriveState, ServedPlant
    from drivecomm.server.modbus_tcp.layout import NumberType

Told: TypeAlias = tuple[Sequence[int], Quality | None]
"""Words, and how far they can be believed; None for what the server itself knows."""

_Value: TypeAlias = tuple[tuple[int, int], Quality, int]
"""Words, quality and age."""

_TAKEN_EVERY_S = 0.01
"""A master sees a value so much later, at most."""


class CurrentValues:
    """The latest of all values of a plant, kept up to date in a door's own event loop."""

    def __init__(self, plant: ServedPlant) -> None:
        self.plant = plant
        self._values: dict[tuple[str, str], CurrentValue] = {}

    async def follow(self) -> None:
        """Take what changes, until cancelled."""
        changes = self.plant.changes(_TAKEN_EVERY_S)
        try:
            self._note(self.plant.values())
            async for values, _ in changes:
                self._note(values)
        finally:
            changes.close()

    def _note(self, values: Sequence[CurrentValue]) -> None:
        for value in values:
            self._values[value.drive, value.name] = value

    def of(self, drive: str, name: str) -> CurrentValue | None:
        """Return the latest of one value, None where there was none yet."""
        return self._values.get((drive, name))


@dataclass(slots=True)
class _Moment:
    """A drive at the time of one read."""

    values: CurrentValues
    drive: DriveState
    now_s: float
    found: dict[tuple[str, NumberType], _Value] = field(default_factory=dict)
    """What was found out before, for other registers of the same value."""
    seen: tuple[CurrentValue | None, Quality, DriveStatus | None] | None = None
    """The same of the status."""

    def value(self, name: str, number: NumberType) -> _Value:
        """Return the words, the quality and the age of a value."""
        key = name, number
        if key not in self.found:
            self.found[key] = self._value(name, number)
        return self.found[key]

    def _value(self, name: str, number: NumberType) -> _Value:
        found = self.values.of(self.drive.name, name)
        if found is None:
            polled = any(name in group.parameters for group in self.drive.config.poll)
            return NOTHING[number], quality_of(None, self.now_s, polled=polled), NO_AGE
        quality = quality_of(found, self.now_s, polled=True)
        if not quality.is_current or found.reading is None:
            return NOTHING[number], quality, NO_AGE
        words = number_words(found.reading.value, number)
        if words is None:
            return NOTHING[number], Quality.UNAVAILABLE, NO_AGE
        return words, quality, age_word(found, self.now_s)

    def status(self, address: int) -> Told:
        """Return one of the words before the values."""
        if address == VERSION_AT:
            return (VERSION,), None
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

    def _status(self) -> tuple[CurrentValue | None, Quality, DriveStatus | None]:
        found = self.values.of(self.drive.name, STATUS)
        quality = quality_of(found, self.now_s, polled=True)
        status = self.drive.status if quality.is_current else None
        if status is None and quality.is_current:
            # The drive has fallen silent between the two.
            quality = Quality.STALE
        return found, quality, status


_Entry: TypeAlias = tuple[int, Callable[[_Moment], Told]]
"""How many registers belong together, and what gives them."""


class UnitRegisters:
    """The registers of one drive that can be read, but for those of commands."""

    def __init__(self, drive: str, own: Sequence[OwnRegister], values: CurrentValues) -> None:
        self.drive = drive
        self._values = values
        self._entries: dict[int, _Entry] = {}
        for address in range(FIXED_END):
            self._entries[address] = (1, _nothing)
        for address in (VERSION_AT, STATE_AT, RAW_WORD_AT, FAULT_AT, STATUS_QUALITY_AT, STATUS_AGE_AT):
            self._entries[address] = (1, _status_at(address))
        for address in range(FIRST_QUANTITY + 2, FIXED_END, VALUE_WORDS):
            self._entries[address] = (1, _unavailable)
            self._entries[address + 1] = (1, _ageless)
        for address, name in FIXED_QUANTITIES:
            self._place(address, name, number_type(name))
        for register in own:
            self._place(register.address, register.name, register.type)

    def _place(self, address: int, name: str, number: NumberType) -> None:
        self._entries[address] = (2, lambda moment: moment.value(name, number)[:2])
        self._entries.pop(address + 1, None)
        self._entries[address + 2] = (1, lambda moment: ((moment.value(name, number)[1],), None))
        self._entries[address + 3] = (1, lambda moment: ((moment.value(name, number)[2],), None))

    def read(self, address: int, count: int) -> list[int]:
        """Return registers. Raises RefusedRequest where one does not exist, is cut in half, or none is current."""
        moment = self._moment()
        words: list[int] = []
        qualities: list[Quality] = []
        end = address + count
        while address < end:
            length, tell = self._entries.get(address, (0, _nothing))
            if not length or address + length > end:
                # Half a number, asked for twice, would be put together from two of them.
                raise RefusedRequest(ExceptionCode.ADDRESS)
            told, quality = tell(moment)
            words += told
            if quality is not None:
                qualities.append(quality)
            address += length
        if qualities and not any(each.is_current for each in qualities):
            silent = any(each is not Quality.UNAVAILABLE for each in qualities)
            raise RefusedRequest(ExceptionCode.NO_RESPONSE if silent else ExceptionCode.NO_PATH)
        return words

    def _moment(self) -> _Moment:
        try:
            state = self._values.plant.drive(self.drive)
        except UsageError:
            # The plant file was read again, and has it no longer.
            raise RefusedRequest(ExceptionCode.NO_PATH) from None
        return _Moment(self._values, state, time.time())


def _nothing(_: _Moment) -> Told:
    return (0,), None


def _unavailable(_: _Moment) -> Told:
    return (Quality.UNAVAILABLE,), None


def _ageless(_: _Moment) -> Told:
    return (NO_AGE,), None


def _status_at(address: int) -> Callable[[_Moment], Told]:
    return lambda moment: moment.status(address)
