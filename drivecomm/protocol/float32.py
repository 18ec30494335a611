"""Floats of 32 bits, as drives hold them, and the decimal numbers that people mean by them."""

from __future__ import annotations

from decimal import Decimal
from math import isfinite
from struct import pack, unpack

# Six digits always come back as they were, and nine tell all floats apart (IEEE 754).
_DIGITS = range(6, 10)


def float_of(bits: int) -> Decimal | None:
    """Return the shortest decimal number that these bits stand for; None where they are no number."""
    number: float = unpack(">f", bits.to_bytes(4, "big"))[0]
    if not isfinite(number):
        return None
    texts = (f"{number:.{digits}g}" for digits in _DIGITS)
    shortest = Decimal(next(text for text in texts if float_bits(float(text)) == bits))
    whole = shortest == shortest.to_integral_value() and abs(shortest) < 10**9
    return shortest.quantize(Decimal(1)) if whole else shortest


def float_bits(number: float) -> int | None:
    """Return the bits of the float that is nearest to a number, None where there is none."""
    try:
        return int.from_bytes(pack(">f", number), "big")
    except OverflowError:
        return None
