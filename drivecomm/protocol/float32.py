"""Floats of 32 bits, as drives hold them, and the decimal numbers that people mean by them."""

from __future__ import annotations

from decimal import Decimal
from math import isfinite
from struct import pack, unpack

# Six digits always survive the conversion, and nine distinguish all floats (IEEE 754).
_DIGITS = range(6, 10)


def float_of(bits: int) -> Decimal | None:
    """Return the shortest decimal number for the bits of a float; None if the bits are not a finite number."""
    number: float = unpack(">f", bits.to_bytes(4, "big"))[0]
    if not isfinite(number):
        return None
    texts = (f"{number:.{digits}g}" for digits in _DIGITS)
    shortest = Decimal(next(text for text in texts if float_bits(float(text)) == bits))
    whole = shortest == shortest.to_integral_value() and abs(shortest) < 10**9
    return shortest.quantize(Decimal(1)) if whole else shortest


def float_bits(number: float) -> int | None:
    """Return the bits of the float that is nearest to a number; None if the number is too large."""
    try:
        return int.from_bytes(pack(">f", number), "big")
    except OverflowError:
        return None
