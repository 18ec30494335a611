"""Data values: sign, five digits and a place for the point, exactly.

VLT Series 3500 manual, printed page 86 (bytes 13 to 19). A value is an integer and a power of ten; binary floating
point never comes near it.
"""

from __future__ import annotations

from decimal import Decimal, InvalidOperation
from typing import Any

DIGITS = 5
DECIMALS = range(6)


def number(value: Any) -> Decimal:
    """Return the number that a field holds: Decimal, whole number or text. Raises ValueError for anything else."""
    if isinstance(value, bool) or not isinstance(value, Decimal | int | str):
        raise ValueError(f"{value!r} is no exact number")  # noqa: TRY004 - one error for all that is no number
    try:
        exact = Decimal(value)
    except InvalidOperation:
        raise ValueError(f"{value!r} is no number") from None
    if not exact.is_finite():
        raise ValueError(f"{value!r} is no number that has an end")
    return exact


def packed(value: Decimal, decimals: int | None) -> tuple[int, int]:
    """Return the five digits as a number, and byte 19.

    decimals: how many digits stand after the point; None for the fewest that are exact. Raises ValueError when the
    value is not exact at that many decimals or has more than five digits: nothing is rounded.
    """
    _, digits, exponent = value.as_tuple()
    power = int(exponent)
    text = "".join(map(str, digits)).lstrip("0")
    significant = text.rstrip("0")
    power += len(text) - len(significant)
    fewest = max(0, -power) if significant else 0
    chosen = fewest if decimals is None else decimals
    if type(chosen) is not int or chosen not in DECIMALS:
        raise ValueError(f"{value} with {chosen!r} decimals; a telegram has 0 to 5")
    if not significant:
        return 0, chosen
    if fewest > chosen:
        raise ValueError(f"{value} is not exact with {chosen} decimals, and it is not rounded")
    if len(significant) + power + chosen > DIGITS:
        raise ValueError(f"{value} with {chosen} decimals has more than {DIGITS} digits")
    return int(significant) * 10 ** (power + chosen), chosen


def unpacked(*, negative: bool, digits: str, decimals: int) -> Decimal:
    """Return the number in bytes 13 to 19, with as many decimals as byte 19 says; minus zero is zero.

    Raises ValueError when the digits are none; spaces are refused, no printed telegram has them.
    """
    if not (digits.isascii() and digits.isdigit()):
        raise ValueError(f"{digits!r} are not {DIGITS} decimal digits")
    # Read from text a number is exact, whatever precision the program has set.
    found = Decimal(f"{digits}E-{decimals}")
    return found.copy_negate() if negative and found else found
