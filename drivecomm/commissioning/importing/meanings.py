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


class Held(NamedTuple):
    """Storage of a value in registers. type: empty for a part of a register. order: high, low or empty."""

    type: str
    part: str = ""
    order: str = ""


_TYPES = {
    "u16": Held("u16"), "s16": Held("s16"), "u32": Held("u32"), "s32": Held("s32"), "f32": Held("f32"),
    "uint16": Held("u16"), "int16": Held("s16"), "uint32": Held("u32"), "int32": Held("s32"),
    "uint": Held("u16"), "word": Held("u16"), "ushort": Held("u16"), "unsigned short": Held("u16"),
    "unsigned": Held("u16"), "unsigned int": Held("u16"), "unsigned16": Held("u16"), "unsigned 16": Held("u16"),
    "unsigned 16 bit": Held("u16"), "uint16 t": Held("u16"), "16 bit unsigned": Held("u16"), "u word": Held("u16"),
    "hex16": Held("u16"), "i16": Held("s16"), "short": Held("s16"), "sint16": Held("s16"), "signed": Held("s16"),
    "signed16": Held("s16"), "signed 16": Held("s16"), "signed 16 bit": Held("s16"), "signed int": Held("s16"),
    "signed short": Held("s16"), "int16 t": Held("s16"), "16 bit signed": Held("s16"), "s word": Held("s16"),
    "dword": Held("u32"), "udint": Held("u32"), "ulong": Held("u32"), "unsigned long": Held("u32"),
    "unsigned32": Held("u32"), "unsigned 32": Held("u32"), "unsigned 32 bit": Held("u32"), "uint32 t": Held("u32"),
    "32 bit unsigned": Held("u32"), "u dword": Held("u32"), "u dword r": Held("u32", order="low"),
    "i32": Held("s32"), "dint": Held("s32"), "long": Held("s32"), "sint32": Held("s32"), "signed32": Held("s32"),
    "signed 32": Held("s32"), "signed 32 bit": Held("s32"), "int32 t": Held("s32"), "32 bit signed": Held("s32"),
    "s dword": Held("s32"), "s dword r": Held("s32", order="low"),
    "float": Held("f32"), "float32": Held("f32"), "real": Held("f32"), "single": Held("f32"), "fp32": Held("f32"),
    "fp32 r": Held("f32", order="low"), "float32 ieee": Held("f32"), "ieee754": Held("f32"), "ieee 754": Held("f32"),
    "uint8 low": Held("", "low"), "uint8l": Held("", "low"), "uint8h": Held("", "high"),
    "without sign": Held("u16"), "with sign": Held("s16"), "ohne vorzeichen": Held("u16"),
    "mit vorzeichen": Held("s16"), "без знака": Held("u16"), "со знаком": Held("s16"), "无符号": Held("u16"),
    "有符号": Held("s16"),
}  # fmt: skip


def held_as(text: str) -> Held | None:
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
