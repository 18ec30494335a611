"""Parameters of an Acme drive and the words that carry them, A10 line manual, sections 3.1 and 5."""

from __future__ import annotations

from decimal import Decimal
from typing import TYPE_CHECKING

from drivecomm.errors import ParameterAddressError, ValueRefusedError
from drivecomm.protocol import Reading, Value, exact, scaled, unscaled

if TYPE_CHECKING:
    from drivecomm.protocol import Model, ParameterInfo

SIGNED = "INT"
_DIGITS = 3


def number_of(parameter: str, model: Model | None) -> tuple[int, ParameterInfo | None]:
    """Return the number of a parameter and its entry in the model, if any. Raises ParameterAddressError."""
    info = model.find(parameter) if model else None
    address = info.address if info else parameter
    if len(address) != _DIGITS or not (address.isascii() and address.isdigit()):
        raise ParameterAddressError(f"{parameter!r} is no parameter of an Acme drive; they are 000 to 999")
    return int(address), info


def physical(info: ParameterInfo, word: int) -> int | Decimal:
    """Return the physical value of a 16-bit word; INT is two's complement."""
    return scaled(word - 0x10000 if info.type == SIGNED and word >= 0x8000 else word, info.factor)


def word_for(parameter: str, info: ParameterInfo | None, value: Value | float) -> int:
    """Return the 16-bit word for a physical value. Raises ValueRefusedError."""
    raw = unscaled(exact(value, parameter), info.factor if info else Decimal(1), parameter, info.unit if info else "")
    signed = info is not None and info.type == SIGNED
    allowed = range(-0x8000, 0x8000) if signed else range(0x10000)
    if raw not in allowed:
        raise ValueRefusedError(f"{value} for parameter {parameter} does not fit into four hexadecimal digits")
    return raw & 0xFFFF


def reading(number: int, info: ParameterInfo | None, word: int) -> Reading:
    """Return a reading of a word, with name and unit from the model."""
    if info is None:
        note = "no model: the unsigned word as sent"
        return Reading(parameter=f"{number:0{_DIGITS}}", value=word, raw=word, note=note)
    return Reading(
        parameter=info.address,
        value=physical(info, word),
        raw=word,
        unit=info.unit,
        type=info.type,
        name=info.name,
        text=info.values.get(word, ""),
    )
