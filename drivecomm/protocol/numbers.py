"""Exact numbers: what a caller gives, made into what a telegram can carry, without rounding."""

from __future__ import annotations

from decimal import Decimal, InvalidOperation
from typing import TYPE_CHECKING

from drivecomm.errors import ValueRefusedError, shortened

if TYPE_CHECKING:
    from drivecomm.protocol.reading import Value

_LARGEST, _SMALLEST = 20, -40
"""Powers of ten. Parameters have 32 bits and a few decimals; larger powers only take time to calculate with."""


def exact(value: Value | float, parameter: str) -> Decimal:
    """Return the number that a caller means: 10.1 is ten and one tenth, whatever binary floats make of it.

    Raises ValueRefusedError for text that is no number, for infinities, and for numbers that no drive can hold.
    """
    try:
        number = Decimal(str(value)) if isinstance(value, float) else Decimal(value)
    except (InvalidOperation, TypeError, ValueError) as error:
        raise ValueRefusedError(f"{shortened(value)} for parameter {parameter} is no number") from error
    if not number.is_finite() or isinstance(value, bool):
        raise ValueRefusedError(f"{shortened(value)} for parameter {parameter} is no number")
    if number.adjusted() > _LARGEST or number.as_tuple().exponent < _SMALLEST:  # type: ignore[operator]
        raise ValueRefusedError(f"{shortened(value)} for parameter {parameter} is beyond what any drive holds")
    return number


def unscaled(physical: Decimal, factor: Decimal, parameter: str, unit: str = "") -> int:
    """Return the whole number that stands for a physical value. Raises ValueRefusedError if it is not exact."""
    try:
        raw = physical / factor
        whole = raw == raw.to_integral_value() and raw * factor == physical
    except ArithmeticError:
        whole = False
    if not whole:
        shown = f"{factor} {unit}".rstrip()
        raise ValueRefusedError(f"{physical} for parameter {parameter} is no multiple of {shown}; it is not rounded")
    return int(raw)


def scaled(raw: int, factor: Decimal) -> int | Decimal:
    """Return the physical value of a raw one; a whole number stays one where there is nothing to scale."""
    return raw if factor == 1 else raw * factor
