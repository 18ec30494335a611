"""Description elements: what a drive tells about a parameter itself (AK 4).

VLT 5000 Design Guide p. 95-98; VLT 5000 Crane manual p. 105-106; unit indices PROFIBUS manual MG.33.C4.02 p. 80.
"""

from __future__ import annotations

from decimal import Decimal
from typing import TYPE_CHECKING

from drivecomm.protocol import Reading
from drivecomm_danfoss_fc.parameters import limit_reading, signed

if TYPE_CHECKING:
    from drivecomm_danfoss_fc.parameters import Target

BASIC, ELEMENTS, CONVERSION, NAME, LOWER_LIMIT, UPPER_LIMIT, DEFAULT, ADDITIONAL = 1, 2, 4, 6, 7, 8, 20, 21

ELEMENT_NAMES = {
    BASIC: "basic characteristics",
    ELEMENTS: "number of array elements",
    CONVERSION: "conversion index and unit",
    NAME: "name",
    LOWER_LIMIT: "lower limit",
    UPPER_LIMIT: "upper limit",
    DEFAULT: "default value",
    ADDITIONAL: "additional characteristics",
}

BASIC_FLAGS = {
    15: "active",
    14: "array",
    13: "can only be reset",
    12: "differs from the factory value",
    11: "text available",
    10: "option texts available",
    9: "read only",
    8: "limits not relevant",
}

UNITS = {
    0: "none",
    4: "time",
    8: "energy",
    9: "power",
    11: "rotation",
    16: "torque",
    17: "temperature",
    21: "voltage",
    22: "current",
    23: "resistance",
    24: "ratio %",
    27: "relative change %",
    28: "frequency",
}

# 74 is hours: the manuals print 0.1, 3.6 and 3600 for it. 67, 75 and 100 stand without a factor or with an SI one; the
# raw value is in rpm, kWh and degrees (specification, sections 10 and 15).
_SPECIAL = {67: "rpm", 70: "minutes", 74: "hours", 75: "kWh", 77: "days", 100: "no conversion"}

_UNITS_OF_SPECIAL = {67: "rpm", 70: "min", 74: "h", 75: "kWh", 77: "d"}
_POWERS_OF_TEN = range(-7, 7)

# Indices of powers of ten count in the base unit of the quantity (specification, section 10). Power is given in kW all
# the same, as the drives show it, and a rotation in rpm.
_BASE_UNITS = {
    4: "s", 8: "J", 9: "kW", 11: "rpm", 16: "Nm", 17: "degC", 21: "V", 22: "A", 23: "Ohm", 24: "%", 27: "%", 28: "Hz"
}  # fmt: skip
_TIME, _POWER = 4, 9


def conversion(index: int) -> str:
    """Return what a conversion index does to the raw value, in words."""
    if index in _SPECIAL:
        return _SPECIAL[index]
    if -7 <= index <= 6:
        return f"factor {Decimal(1).scaleb(index).normalize():f}"
    return "not listed"


def unit_and_factor(index: int, unit_index: int) -> tuple[str, Decimal]:
    """Return unit and factor of a value by its conversion index and unit index; no unit and 1 where they do not tell.

    Times with three decimals and more are in milliseconds, as the drives show them.
    """
    if index in _UNITS_OF_SPECIAL:
        return _UNITS_OF_SPECIAL[index], Decimal(1)
    unit = _BASE_UNITS.get(unit_index, "")
    if index in _SPECIAL:
        return unit, Decimal(1)
    if index not in _POWERS_OF_TEN or unit_index not in UNITS:
        return "", Decimal(1)
    if unit_index == _TIME and index <= -3:
        unit, index = "ms", index + 3
    elif unit_index == _POWER:
        index -= 3
    return unit, Decimal(f"{Decimal(1).scaleb(index):f}")


def description_reading(wanted: Target, element: int, pwe: int) -> Reading:
    """Return the reading of one description element that came as a number."""
    name = ELEMENT_NAMES.get(element, f"element {element}")
    note = f"description element {element}, {name}"
    if element in (LOWER_LIMIT, UPPER_LIMIT, DEFAULT):
        return limit_reading(wanted, pwe, note)
    low = pwe & 0xFFFF
    text = ""
    if element == BASIC:
        flags = [flag for bit, flag in BASIC_FLAGS.items() if low >> bit & 1]
        text = ", ".join([f"data type {low & 0xFF}", *flags])
    elif element == CONVERSION:
        index, unit = signed(low >> 8, 8), low & 0xFF
        text = f"conversion index {index} ({conversion(index)}), unit index {unit} ({UNITS.get(unit, 'not listed')})"
        if unit not in UNITS:
            note += "; the unit index is not listed: this drive may send the two bytes the other way round (V5P p. 14)"
    return Reading(
        parameter=wanted.address, value=pwe, raw=pwe, name=wanted.info.name if wanted.info else "", text=text, note=note
    )
