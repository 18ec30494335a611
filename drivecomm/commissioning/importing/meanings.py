"""Meanings of words and numbers in foreign files: units, factors, types, texts of values."""

from __future__ import annotations

import re
from decimal import Decimal, InvalidOperation
from fractions import Fraction
from typing import NamedTuple

_UNITS = {
    "hz": "Hz", "hertz": "Hz", "гц": "Hz", "赫兹": "Hz", "khz": "kHz", "кгц": "kHz",
    "a": "A", "amp": "A", "amps": "A", "ampere": "A", "ampère": "A", "а": "A", "安": "A", "ma": "mA", "ма": "mA",
    "v": "V", "volt": "V", "volts": "V", "в": "V", "伏": "V", "vac": "V", "vdc": "V", "mv": "mV", "kv": "kV",
    "w": "W", "watt": "W", "вт": "W", "kw": "kW", "квт": "kW", "千瓦": "kW",
    "wh": "Wh", "kwh": "kWh", "квтч": "kWh", "квт·ч": "kWh", "квт*ч": "kWh", "mwh": "MWh",
    "s": "s", "sec": "s", "sek": "s", "second": "s", "seconds": "s", "с": "s", "сек": "s", "秒": "s", "ms": "ms",
    "мс": "ms", "min": "min", "мин": "min", "h": "h", "hr": "h", "hrs": "h", "hour": "h", "hours": "h", "ч": "h",
    "час": "h", "std": "h", "小时": "h",
    "rpm": "rpm", "r/min": "rpm", "1/min": "rpm", "min-1": "rpm", "min^-1": "rpm", "u/min": "rpm", "tr/min": "rpm",
    "rev/min": "rpm", "об/мин": "rpm", "转/分": "rpm", "rotations per minute": "rpm",
    "°c": "degC", "℃": "degC", "degc": "degC", "deg c": "degC", "grad c": "degC", "celsius": "degC", "c": "degC",
    "%": "%", "percent": "%", "prozent": "%", "процент": "%", "nm": "Nm", "n·m": "Nm", "n.m": "Nm", "нм": "Nm",
}  # fmt: skip
"""Common spellings of units in lower case, with the spelling of drive models."""

_WITHOUT = frozenset(("", "-", "--", "—", "none", "n/a", "na", "bool", "bit", "0/1", "无", "нет"))
_OTHER_UNIT = re.compile(r"[^\W\d_][^\d\s\"']{0,9}")
"""Pattern of units that are rare on drives, such as bar or m3/h without its digit; they are kept unchanged."""

_STEP = re.compile(r"(\d+(?:[.,]\d+)?)\s*([^\d\s].*)?")
_TITLE_UNIT = re.compile(r"(.*?)\s*(?:[\[(]\s*([^\])]*)\s*[\])]|[,;/]\s*([^\s,;/]+))\s*")
_TEXT_OF_VALUE = re.compile(r"\s*(0x[0-9a-f]+|-?\d+)\s*(?:[:=→]|->|[-–](?=\s|[^\W\d]))\s*(.+?)\s*", re.IGNORECASE)

_FURTHER_VALUE = re.compile(r"\d\s*[:=→]")


_MOST_DIGITS = 12
"""Limit of digits before and after the decimal point: more than any register, address or factor has."""


def number_in(text: object) -> Decimal | None:
    """Return the number in a cell or key, with a decimal point or comma; None if it is not a number."""
    if isinstance(text, bool):
        return None
    try:
        found = Decimal(str(text).strip().replace(",", "."))
    except InvalidOperation:
        return None
    return found if found.is_finite() and (not found or abs(found.adjusted()) < _MOST_DIGITS) else None


def whole_in(text: object) -> int | None:
    """Return the whole number in a key, written as 8451 or 0x2103; None if it is not a whole number."""
    if isinstance(text, bool):
        return None
    if isinstance(text, int):
        return text if abs(text) < 10**_MOST_DIGITS else None
    try:
        found = int(str(text).strip()[: _MOST_DIGITS + 2], 0)
    except ValueError:
        number = number_in(text)
        return int(number) if number is not None and number == number.to_integral_value() else None
    return found if abs(found) < 10**_MOST_DIGITS else None


def ratio(multiplier: Decimal | int, divider: Decimal | int) -> Decimal | None:
    """Return multiplier / divider if it is exact as a decimal number, else None."""
    if not divider or not multiplier:
        return None
    exact = Fraction(multiplier) / Fraction(divider)
    rest = exact.denominator
    for prime in (2, 5):
        while rest % prime == 0:
            rest //= prime
    return plain(Decimal(exact.numerator) / Decimal(exact.denominator)) if rest == 1 else None


def plain(number: Decimal) -> Decimal:
    """Return a number without trailing zeros and without an exponent."""
    short = number.normalize()
    return short.quantize(Decimal(1)) if short == short.to_integral_value() else short


def unit_in(text: str) -> tuple[str, Decimal] | None:
    """Return a unit in the spelling of models, and the step before it, as in `0.01 Hz`; None if it is not a unit."""
    word = " ".join(text.split()).casefold().replace("º", "°")
    if word in _WITHOUT:
        return "", Decimal(1)
    if word in _UNITS:
        return _UNITS[word], Decimal(1)
    if _OTHER_UNIT.fullmatch(word):
        return " ".join(text.split()), Decimal(1)
    step = _STEP.fullmatch(word)
    factor = number_in(step[1]) if step else None
    known = unit_in(step[2] or "") if step else None
    return (known[0], plain(factor)) if factor and known else None


def title_and_unit(title: str) -> tuple[str, str, Decimal]:
    """Split a title such as `Current (0.1 A)` into the title without its unit, the unit, and the step."""
    found = _TITLE_UNIT.fullmatch(title)
    if found is not None and found[1]:
        known = unit_in(found[2] or found[3] or "?")
        if known is not None and known[0] in _UNITS.values():
            return found[1], *known
    return title, "", Decimal(1)


class RegisterStorage(NamedTuple):
    """Storage of a value in registers. type: empty for a part of a register. order: high, low or empty."""

    type: str
    part: str = ""
    order: str = ""


U16, S16, U32, S32, F32 = (RegisterStorage(each) for each in ("u16", "s16", "u32", "s32", "f32"))
_U32_SWAPPED, _S32_SWAPPED, _F32_SWAPPED = (each._replace(order="low") for each in (U32, S32, F32))
_TYPES = {
    "u16": U16, "s16": S16, "u32": U32, "s32": S32, "f32": F32,
    "uint16": U16, "int16": S16, "uint32": U32, "int32": S32,
    "uint": U16, "word": U16, "ushort": U16, "unsigned short": U16,
    "unsigned": U16, "unsigned int": U16, "unsigned16": U16, "unsigned 16": U16,
    "unsigned 16 bit": U16, "uint16 t": U16, "16 bit unsigned": U16, "u word": U16,
    "hex16": U16, "i16": S16, "short": S16, "sint16": S16, "signed": S16,
    "signed16": S16, "signed 16": S16, "signed 16 bit": S16, "signed int": S16,
    "signed short": S16, "int16 t": S16, "16 bit signed": S16, "s word": S16,
    "dword": U32, "udint": U32, "ulong": U32, "unsigned long": U32,
    "unsigned32": U32, "unsigned 32": U32, "unsigned 32 bit": U32, "uint32 t": U32,
    "32 bit unsigned": U32, "u dword": U32, "u dword r": _U32_SWAPPED,
    "i32": S32, "dint": S32, "long": S32, "sint32": S32, "signed32": S32,
    "signed 32": S32, "signed 32 bit": S32, "int32 t": S32, "32 bit signed": S32,
    "s dword": S32, "s dword r": _S32_SWAPPED,
    "float": F32, "float32": F32, "real": F32, "single": F32, "fp32": F32,
    "fp32 r": _F32_SWAPPED, "float32 ieee": F32, "ieee754": F32, "ieee 754": F32,
    "uint8 low": RegisterStorage("", "low"), "uint8l": RegisterStorage("", "low"),
    "uint8h": RegisterStorage("", "high"),
    "without sign": U16, "with sign": S16, "ohne vorzeichen": U16,
    "mit vorzeichen": S16, "без знака": U16, "со знаком": S16, "无符号": U16,
    "有符号": S16,
}  # fmt: skip


def held_as(text: str) -> RegisterStorage | None:
    """Return the storage that a type word stands for, None for an unknown or ambiguous word.

    `int` has 16 bits in IEC 61131-3 and another width elsewhere, and `16 bit` states no sign, so both are ambiguous.
    """
    word = " ".join(re.sub(r"[^\w]+|_", " ", text.casefold()).split())
    return _TYPES.get(word) or _TYPES.get(word.replace(" ", ""))


def texts_in(text: str) -> dict[int, str]:
    """Return the texts of values in a cell such as `0: stop; 1: run`, empty if any part of it is something else."""
    found: dict[int, str] = {}
    for separator in (";", "\n", "|", ",", "/"):
        parts = [part for part in text.split(separator) if part.strip()]
        matches = [_TEXT_OF_VALUE.fullmatch(part) for part in parts]
        if parts and all(matches):
            found = {int(each[1], 0): each[2] for each in matches if each}
            if len(parts) > 1:
                break
    return {} if any(_FURTHER_VALUE.search(each) for each in found.values()) else found
