"""Description elements: the facts that a drive reports about a parameter (AK 4).

Their names, flags and units are in tables.toml, with the pages.
"""

from __future__ import annotations

from decimal import Decimal
from typing import TYPE_CHECKING

from drivecomm_danfoss_fc.parameters import limit_reading, signed
from drivecomm_danfoss_fc.tables import table

if TYPE_CHECKING:
    from drivecomm.protocol import Reading
    from drivecomm_danfoss_fc.parameters import Target

BASIC, ELEMENTS, CONVERSION, NAME, LOWER_LIMIT, UPPER_LIMIT, DEFAULT, ADDITIONAL = 1, 2, 4, 6, 7, 8, 20, 21

_POWERS_OF_TEN = range(-7, 7)
_TIME, _POWER = 4, 9


def conversion(index: int) -> str:
    """Return the effect of a conversion index on the raw value, in words."""
    if index in _POWERS_OF_TEN:
        return f"factor {Decimal(1).scaleb(index).normalize():f}"
    return str(table("conversions").get(index, {"words": "not listed"})["words"])


def unit_and_factor(index: int, unit_index: int) -> tuple[str, Decimal]:
    """Return unit and factor of a value by its conversion index and unit index; no unit and 1 if they are unknown.

    Times with three or more decimals are in milliseconds, as the drives show them.
    """
    known, special = table("units").get(unit_index), table("conversions").get(index)
    unit = known["unit"] if known else ""
    if special is not None:
        return special["unit"] or unit, Decimal(1)
    if index not in _POWERS_OF_TEN or known is None:
        return "", Decimal(1)
    if unit_index == _TIME and index <= -3:
        unit, index = "ms", index + 3
    elif unit_index == _POWER:
        index -= 3
    return unit, Decimal(f"{Decimal(1).scaleb(index):f}")


def unit_index(unit: str) -> int:
    """Return the unit index for the unit of a model, 0 if it has none."""
    units = table("units").items()
    return next((index for index, each in units if unit in (each["unit"], *each.get("shown", ()))), 0)


def description_reading(wanted: Target, element: int, pwe: int) -> Reading:
    """Return the reading of a description element that was received as a number."""
    name = table("elements").get(element, f"element {element}")
    note = f"description element {element}, {name}"
    if element in (LOWER_LIMIT, UPPER_LIMIT, DEFAULT):
        return limit_reading(wanted, pwe, note)
    low = pwe & 0xFFFF
    text = ""
    if element == BASIC:
        flags = [flag for bit, flag in table("flags").items() if low >> bit & 1]
        text = ", ".join([f"data type {low & 0xFF}", *flags])
    elif element == CONVERSION:
        index, unit = signed(low >> 8, 8), low & 0xFF
        known = table("units").get(unit)
        quantity = known["quantity"] if known else "not listed"
        text = f"conversion index {index} ({conversion(index)}), unit index {unit} ({quantity})"
        if known is None:
            note += "; the unit index is not listed: this drive may send the two bytes the other way round (V5P p. 14)"
    return wanted.reading(value=pwe, raw=pwe, text=text, note=note)
