"""Machine units: the units in which machines count their speed, such as metres, strokes or bottles a minute."""

from __future__ import annotations

import re
from contextlib import suppress
from dataclasses import dataclass, fields
from decimal import Decimal
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from drivecomm.errors import UsageError, ValueRefusedError, shortened
from drivecomm.protocol.reading import exact

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.protocol.reading import Reading, Value

SPEED_QUANTITIES = frozenset(
    {"output_frequency", "reference_frequency", "minimum_frequency", "maximum_frequency", "jog_frequency"}
)
"""Common names of frequencies at which the motor turns, or would turn."""

_LONGEST_UNIT = 20
_MOST_POLES = 100
_PLACES_HZ = 2
_TURNS = frozenset({"rpm", "1/min", "r/min", "rev/min", "U/min", "min-1", "min⁻¹"})
_A_MINUTE = re.compile(r"/ ?min(ute)?$|[a-z]pm$")


@dataclass(frozen=True, slots=True, kw_only=True)
class MachineValue:
    """A speed of the machine for display.

    value: rounded to the resolution of the frequency behind it.
    """

    value: Decimal
    unit: str

    def __str__(self) -> str:
        return f"{self.value:f} {self.unit}"


@dataclass(frozen=True, slots=True, kw_only=True)
class MachineUnit:
    """Machine unit of a drive, and the speed of its machine at an output frequency of one hertz.

    unit: such as "m/min". per_hz: units at 1 Hz. Instead of per_hz: poles: the number of poles of the motor (not pole
    pairs); gear: turns of the motor's shaft for one turn of the machine's shaft, 1 unless given; per_turn: units for
    one turn of the machine's shaft, left out if the unit itself counts turns, such as "rpm". A speed computed from the
    poles is the synchronous speed, without slip, and its unit counts minutes. Numbers may be text or float; they become
    exact decimals. Raises UsageError for invalid values.
    """

    unit: str
    per_hz: Decimal | None = None
    poles: int | None = None
    gear: Decimal | None = None
    per_turn: Decimal | None = None

    def __post_init__(self) -> None:
        _check_unit(self.unit)
        for key in ("per_hz", "gear", "per_turn"):
            value = getattr(self, key)
            if value is not None:
                object.__setattr__(self, key, _above_zero(key, value))
        if (self.per_hz is None) == (self.poles is None):
            raise UsageError('a machine has either per_hz or poles; write per_hz = "1.25", or poles = 4 and gear = "5"')
        if self.poles is None:
            for key in ("gear", "per_turn"):
                if getattr(self, key) is not None:
                    raise UsageError(f"{key} belongs to poles, and per_hz already defines the unit; leave {key} out")
            return
        self._check_poles(self.poles)

    def _check_poles(self, poles: object) -> None:
        if type(poles) is not int or poles % 2 or not 2 <= poles <= _MOST_POLES:
            raise UsageError(
                f"invalid poles = {shortened(poles)}; write the number of poles of the motor, an even number from 2 to "
                f"{_MOST_POLES}, such as 4"
            )
        turns = self.unit in _TURNS
        if not turns and not _A_MINUTE.search(self.unit):
            raise UsageError(
                f"poles give a speed per minute, and {self.unit} is not one; write a unit such as m/min, or per_hz"
            )
        if turns == (self.per_turn is not None):
            raise UsageError(
                f"{self.unit} already counts turns; leave per_turn out"
                if turns
                else f'the number of {self.unit} per turn a minute is unknown; write per_turn, such as "0.314"'
            )

    @property
    def content(self) -> Mapping[str, Any]:
        """Keys and values of the unit in a plant file, with numbers as text so that none is rounded."""
        said = {each.name: getattr(self, each.name) for each in fields(self)}
        return {key: str(value) if isinstance(value, Decimal) else value for key, value in said.items() if value}

    @property
    def factor(self) -> Fraction:
        """Machine units at 1 Hz."""
        if self.per_hz is not None:
            return Fraction(self.per_hz)
        turns = Fraction(120, self.poles or 2) / Fraction(self.gear or 1)
        return turns * Fraction(self.per_turn or 1)

    def from_hz(self, hz: Decimal | Fraction) -> Fraction:
        """Return the exact speed of the machine at a frequency."""
        return Fraction(hz) * self.factor

    def to_hz(self, value: Decimal | Fraction) -> Fraction:
        """Return the exact frequency for a speed of the machine."""
        return Fraction(value) / self.factor

    def reference_hz(self, value: Value | float) -> Decimal:
        """Return the frequency to set for a speed of the machine, to the nearest 0.01 Hz.

        value: a number, or a text such as "12.5 m/min". Raises ValueRefusedError for another unit, for a text without a
        number, and for a speed other than 0 that would be rounded to 0 Hz.
        """
        number = self._number_of(value)
        hz = _rounded(self.to_hz(number), _PLACES_HZ)
        if number and not hz:
            raise ValueRefusedError(
                f"a reference of {number} {self.unit} is nearest to 0 Hz, a standstill; give 0 or a higher speed"
            )
        return hz

    def shown(self, hz: Decimal | int) -> MachineValue:
        """Return the speed of the machine at a frequency that was read, with as many digits as the frequency has.

        Digits below 0.01 Hz do not count, since they result from computing the frequency from a percentage.
        """
        frequency = Decimal(hz)
        exponent = frequency.as_tuple().exponent
        step = Fraction(10) ** max(-_PLACES_HZ, min(int(exponent), 0)) * self.factor
        places = 0
        while step < 1:
            step *= 10
            places += 1
        return MachineValue(value=_rounded(self.from_hz(frequency), places), unit=self.unit)

    def beside(self, reading: Reading) -> MachineValue | None:
        """Return the speed of the machine for a reading; None unless it is a frequency at which the motor turns."""
        if reading.name not in SPEED_QUANTITIES or reading.unit != "Hz" or isinstance(reading.value, str):
            return None
        return self.shown(reading.value)

    def _number_of(self, value: Value | float) -> Decimal:
        if not isinstance(value, str):
            return exact(value, "reference")
        text = value.strip()
        with suppress(ValueRefusedError):
            return exact(text, "reference")
        number = text.removesuffix(self.unit)
        # 1001/min may mean 1001 /min or 100 1/min.
        runs_on = self.unit[0].isdigit() and number[-1:].isdigit()
        if number == text or runs_on:
            raise ValueRefusedError(
                f"{shortened(value)} is not a reference in {self.unit}, the unit of this machine; write 10 {self.unit}"
            )
        return exact(number.strip(), "reference")


def _check_unit(unit: object) -> None:
    if not isinstance(unit, str) or not unit or unit != unit.strip() or not unit.isprintable():
        raise UsageError(f'invalid unit = {shortened(unit)}; write the unit of the machine, such as "m/min"')
    if len(unit) > _LONGEST_UNIT:
        raise UsageError(f"invalid unit = {shortened(unit)}; write up to {_LONGEST_UNIT} characters")
    if unit.casefold() in ("hz", "%"):
        raise UsageError(
            f'invalid unit = {unit}, which every reference supports; write the unit of the machine, "m/min"'
        )


def _above_zero(key: str, value: Any) -> Decimal:
    with suppress(ValueRefusedError):
        number = exact(value, key)
        if number > 0:
            return number
    raise UsageError(f'invalid {key} = {shortened(value)}; write a number above 0, such as "1.25"')


def _rounded(value: Fraction, places: int) -> Decimal:
    """Return the nearest number with this many decimal places, whatever the precision of the decimal context is."""
    whole = Decimal(round(value * 10**places))
    return Decimal((int(whole < 0), whole.as_tuple().digits, -places))
