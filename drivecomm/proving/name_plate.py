"""Plausibility rules for the values of one drive: rated values, limits, and the readings of a standing motor.

A factor of ten, a swapped pair or a wrong parameter breaks one of these rules on nearly every real drive. The bounds
are wide on purpose. A value of 0 counts as never set, and breaks no rule.
"""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal
from math import ceil, floor, sqrt
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

_RANGES: Mapping[str, tuple[float, float]] = {
    "motor_rated_voltage": (100, 1000),  # V; low-voltage motors of drives for 115 to 690 V
    "motor_rated_frequency": (10, 1500),  # Hz; servo and spindle motors included
    "motor_rated_speed": (100, 60000),  # rpm
    "motor_rated_power": (0.01, 3000),  # kW
    "motor_rated_current": (0.05, 5000),  # A
    "maximum_frequency": (10, 1500),  # Hz
    "dc_link_voltage": (100, 1300),  # V; the mains are off below 100 V
    "heat_sink_temperature": (-30, 120),  # degC
    "inside_temperature": (-30, 100),  # degC
    "switching_frequency": (0.5, 20),  # kHz
    "acceleration_time": (0.01, 3600),  # s
    "deceleration_time": (0.01, 3600),  # s
    "current_limit": (5, 400),  # %
    "drive_thermal_load": (0, 200),  # %
    "motor_thermal_load": (0, 200),  # %
    "operating_hours": (0, 500000),  # h
}
_MOST_POLE_PAIRS = 12
_MOST_SLIP = 0.2


@dataclass(frozen=True, slots=True)
class BrokenRule:
    """A rule that the values break. names: the common names in the rule. text: the mistake, with the values."""

    names: tuple[str, ...]
    text: str


def broken_rules(plate: Mapping[str, Decimal], *, stands: bool, address: int | None = None) -> Iterator[BrokenRule]:
    """Yield each rule that the values of one drive break; the values have common names and common units.

    stands: whether the motor stands. address: the drive's address on the line.
    """
    known = {name: float(value) for name, value in plate.items() if value}
    for name, (low, high) in _RANGES.items():
        if name in known and not low <= known[name] <= high:
            yield BrokenRule((name,), f"{name} {known[name]:g} is not within {low:g} to {high:g}")
    for names, holds, text in _RELATIONS:
        if all(each in known for each in names) and not holds(*(known[each] for each in names)):
            values = ", ".join(f"{each} {known[each]:g}" for each in names)
            yield BrokenRule(names, f"{values}: {text}")
    if stands:
        for name, most in _STANDING.items():
            if abs(known.get(name, 0.0)) > most:
                yield BrokenRule((name,), f"{name} {known[name]:g} while the motor stands")
    if address is not None and "bus_address" in known and known["bus_address"] != address:
        yield BrokenRule(("bus_address",), "it is not the address at which the drive was asked")


def scale_shown(name: str, plate: Mapping[str, Decimal], *, stands: bool) -> bool:
    """Whether a tenfold or a tenth of the value of a common name would break a rule."""
    if not plate.get(name):
        return False
    return all(
        any(name in each.names for each in broken_rules({**plate, name: plate[name] * factor}, stands=stands))
        for factor in (Decimal(10), Decimal("0.1"))
    )


def _speed_fits(frequency: float, speed: float) -> bool:
    first = max(1, floor(60 * frequency * (1 - _MOST_SLIP) / speed))
    last = min(_MOST_POLE_PAIRS, ceil(60 * frequency / speed))
    return any(
        speed <= 60 * frequency / pairs * 1.001 and speed >= 60 * frequency / pairs * (1 - _MOST_SLIP)
        for pairs in range(first, last + 1)
    )


def _power_fits(power: float, voltage: float, current: float) -> bool:
    # The product of efficiency and power factor is 0.3 for the smallest motors, and 0.9 for large ones.
    return 0.2 <= power * 1000 / (sqrt(3) * voltage * current) <= 1.15


_RELATIONS: tuple[tuple[tuple[str, ...], Callable[..., bool], str], ...] = (
    (("motor_rated_frequency", "motor_rated_speed"), _speed_fits, "no number of poles makes that speed"),
    (
        ("motor_rated_power", "motor_rated_voltage", "motor_rated_current"),
        _power_fits,
        "voltage and current do not make that power",
    ),
    (
        ("maximum_frequency", "motor_rated_frequency"),
        lambda most, rated: 0.2 < most / rated <= 8,
        "a maximum so far from the rated frequency is hardly intended",
    ),
    (
        ("minimum_frequency", "maximum_frequency"),
        lambda least, most: least <= most,
        "the minimum is above the maximum",
    ),
    (
        ("reference_frequency", "maximum_frequency"),
        lambda reference, most: abs(reference) <= 1.1 * most,
        "the reference is beyond the maximum",
    ),
    (
        ("jog_frequency", "maximum_frequency"),
        lambda jog, most: abs(jog) <= 1.1 * most,
        "the jog frequency is beyond the maximum",
    ),
    (
        ("dc_link_voltage", "motor_rated_voltage"),
        lambda link, rated: 0.9 <= link / rated <= 3.2,
        "the link of a drive for that motor has 1.3 to 2.5 times its voltage, unless the mains are off",
    ),
    (
        ("running_hours", "operating_hours"),
        lambda running, on: running <= on,
        "it ran for longer than it was on",
    ),
)

_STANDING: Mapping[str, float] = {
    "output_frequency": 1.0,
    "motor_speed": 60.0,
    "output_power": 0.5,
    "torque_percent": 30.0,
}
"""Highest plausible readings of a drive whose output is off."""
