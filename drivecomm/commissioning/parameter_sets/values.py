"""Values of parameters: when two are the same, and what one is in another unit."""

from __future__ import annotations

from decimal import Decimal, InvalidOperation
from typing import TYPE_CHECKING

from drivecomm.errors import UsageError
from drivecomm.models import converted

if TYPE_CHECKING:
    from drivecomm.protocol import Value


def same(left: Value, right: Value) -> bool:
    """Return whether two values are the same: 10, 10.00 and a "10.00" that somebody wrote for a number are."""
    if isinstance(left, str) is isinstance(right, str):
        return left == right
    try:
        return Decimal(left) == Decimal(right)
    except InvalidOperation:
        return False


def in_unit(value: Value, given: str, wanted: str) -> Value:
    """Return a value in another unit, exactly. Raises UsageError where that is not known or it is no number."""
    if given == wanted:
        return value
    try:
        number = Decimal(value)
    except InvalidOperation:
        raise UsageError(f"{value!r} is no number and cannot be given in {wanted or 'another unit'}") from None
    return converted(number, given, wanted)
