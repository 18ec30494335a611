"""Units that one quantity is given in by different makers, and what one is in another, exactly."""

from __future__ import annotations

from decimal import Decimal

from drivecomm.errors import UsageError

# Unit, unit that it is counted in, and how many of those it is. Only what a decimal number says exactly.
_PARTS: dict[str, tuple[str, Decimal]] = {
    "kHz": ("Hz", Decimal(1000)),
    "mA": ("A", Decimal("0.001")),
    "mV": ("V", Decimal("0.001")),
    "kV": ("V", Decimal(1000)),
    "W": ("kW", Decimal("0.001")),
    "Wh": ("kWh", Decimal("0.001")),
    "MWh": ("kWh", Decimal(1000)),
    "ms": ("s", Decimal("0.001")),
    "min": ("s", Decimal(60)),
    "1/min": ("rpm", Decimal(1)),
    "deg C": ("degC", Decimal(1)),
    "°C": ("degC", Decimal(1)),
}


def factor_between(given: str, wanted: str) -> Decimal | None:
    """Return what a number in one unit is multiplied by to be in another; None where that is not known exactly."""
    if given == wanted:
        return Decimal(1)
    counted, parts = _PARTS.get(given, (given, Decimal(1)))
    into, of = _PARTS.get(wanted, (wanted, Decimal(1)))
    if counted != into:
        return None
    return (parts / of).normalize()


def converted(value: Decimal, given: str, wanted: str) -> Decimal:
    """Return a value in another unit, without zeros behind it that say nothing. Raises UsageError."""
    factor = factor_between(given, wanted)
    if factor is None:
        raise UsageError(f"{given or 'a number without unit'} cannot be given in {wanted or 'a number without unit'}")
    return value if factor == 1 else value * factor
