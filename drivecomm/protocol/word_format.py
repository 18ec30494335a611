"""Values in words of 16 bits, in registers or in telegrams: the reading for a word, and the word for a value."""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal
from struct import pack, unpack
from typing import TYPE_CHECKING

from drivecomm.errors import ValueRefusedError
from drivecomm.protocol.float32 import float_bits, float_of
from drivecomm.protocol.reading import exact, must_fit, new_reading, scaled, unscaled

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivecomm.protocol.model import ParameterInfo
    from drivecomm.protocol.reading import Reading, Value

_RANGES = {
    "u16": range(0x10000),
    "s16": range(-0x8000, 0x8000),
    "u32": range(0x100000000),
    "s32": range(-0x80000000, 0x80000000),
}
WORD_TYPES = (*_RANGES, "f32", "string", "digits")
"""Types of values in words.

A type that ends with 32 takes two words; a string takes a word for two characters. digits: three digits with an
exponent: bit 15 the sign, bits 14 to 12 zero, 11 and 10 how many zeros follow, 9 to 0 the digits (Fuji data format
[12]).
"""
_TENS = (1, 10, 100, 1000)


@dataclass(frozen=True, slots=True, kw_only=True)
class WordFormat:
    """Layout of a value in words.

    type: one of WORD_TYPES, empty for a word of unknown type. size: number of words. low_first: whether the low word
    comes first. allowed: the whole numbers that fit, if they differ from those of the type. scale: the factor if no
    model gives one.
    """

    type: str = ""
    size: int = 1
    low_first: bool = False
    allowed: range | None = None
    scale: Decimal = Decimal(1)

    def raw_of(self, words: Sequence[int]) -> int | str:
        """Return the unsigned number or the text in these words."""
        if self.type == "string":
            return pack(f">{len(words)}H", *words).decode("latin-1").rstrip("\0 ")
        if self.size == 1:
            return words[0]
        high, low = reversed(words) if self.low_first else words
        return high << 16 | low

    def words_of(self, raw: int | str) -> tuple[int, ...]:
        """Return the words that hold a raw value."""
        if isinstance(raw, str):
            return unpack(f">{self.size}H", raw.encode("latin-1").ljust(2 * self.size, b" "))
        if self.size == 1:
            return (raw if self.allowed else raw & 0xFFFF,)
        words = raw >> 16 & 0xFFFF, raw & 0xFFFF
        return words[::-1] if self.low_first else words

    def reading(self, raw: int | str, parameter: str, info: ParameterInfo | None, name: str = "") -> Reading:
        """Return the reading for a raw value of a parameter.

        name: the name that the caller requested.
        """
        value: Value = raw
        note, doubt, factor = info.note if info else "", "", info.factor if info else self.scale
        if info is None and not self.type:
            note = "no model: the bare number"
        elif self.type == "f32" and isinstance(raw, int):
            number = float_of(raw)
            if number is None:
                doubt = "not a number: the bare pattern of a float"
            else:
                value = number * factor
        elif self.type == "digits" and isinstance(raw, int) and raw & 0x7000:
            doubt = "not a number: bits 14 to 12 are not zero"
        elif isinstance(raw, int):
            value = scaled(self._signed(raw), factor)
        return new_reading(
            parameter=parameter,
            value=value,
            raw=raw,
            unit=info.unit if info else "",
            type=self.type or ("u16" if info else ""),
            name=name or (info.name if info else ""),
            text=info.values.get(int(value), "") if info and isinstance(value, int) else "",
            note=note,
            doubt=doubt,
        )

    def raw_for(
        self, value: Value | float, parameter: str, info: ParameterInfo | None, *, rounded: bool = False
    ) -> int | str:
        """Return the raw value to write for a physical value. Raises ValueRefusedError if there is none.

        rounded: whether a value between two steps is rounded to the nearest step.
        """
        if self.type == "string":
            if not isinstance(value, str) or len(value) > 2 * self.size or not value.isascii():
                raise ValueRefusedError(
                    f"{value!r} for parameter {parameter} is not a text of up to {2 * self.size} ASCII characters"
                )
            return value.rstrip("\0 ")
        number = exact(value, parameter)
        what = f"{number} for parameter {parameter}"
        factor, unit = (info.factor, info.unit) if info else (self.scale, "")
        if info is not None:
            info.check(number)
        if self.type == "f32":
            return _float_pattern(number / factor, parameter)
        raw = int((number / factor).to_integral_value()) if rounded else unscaled(number, factor, parameter, unit)
        if self.type == "digits":
            return _digits_pattern(raw, what)
        held = self.type or "u16"
        must_fit(raw, self.allowed or _RANGES[held], what, factor, unit=unit, type=held)
        return raw if raw >= 0 else raw & (0xFFFFFFFF if self.size == 2 else 0xFFFF)

    def _signed(self, raw: int) -> int:
        if self.type == "digits":
            steps = (raw & 0x3FF) * _TENS[raw >> 10 & 3]
            return -steps if raw & 0x8000 else steps
        bits = {"s16": 16, "s32": 32}.get(self.type, 0)
        return raw - (1 << bits) if bits and raw >> (bits - 1) else raw


def _float_pattern(number: Decimal, parameter: str) -> int:
    bits = float_bits(float(number))
    if bits is None:
        raise ValueRefusedError(f"{number} for parameter {parameter} is beyond what a float of 32 bits holds")
    return bits


def _digits_pattern(steps: int, what: str) -> int:
    """Return the word for a number of steps, with the smallest exponent.

    what: the value and its parameter, for an error.
    """
    for exponent, ten in enumerate(_TENS):
        digits, rest = divmod(abs(steps), ten)
        if not rest and digits <= 999:
            return (0x8000 if steps < 0 else 0) | exponent << 10 | digits
    raise ValueRefusedError(f"{what} has more than the three digits, with up to three zeros, that the drive holds")
