"""Meanings of the four hexadecimal digits of a function: as a number, by the manuals' data formats, and as bits.

The operation command (S06, M13), the operation status (M14) and other words whose bits or digits have names: FVR-E11S
manual 9-20; GE AF-300 Ethernet manual 35-37; FRENIC-VG manual 6-68; FRENIC-Ace manual 9-39; HVAC/AQUA RS-485 manual
5-73. tables.toml has the data formats.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from decimal import Decimal
from typing import TYPE_CHECKING

from drivecomm import profiles
from drivecomm.errors import UsageError, ValueRefusedError
from drivecomm.protocol import exact, scaled, unscaled
from drivecomm_fuji.generations import TABLES, error_text

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from drivecomm.profiles import ControlProfile
    from drivecomm_fuji.generations import Profile
    from drivecomm_fuji.options import FujiOptions

FREQUENCY_PU, FREQUENCY, COMMAND = "S01", "S05", "S06"
MAXIMUM_FREQUENCY = "F03"
STATUS, ALARM, ERROR = "M14", "M16", "M26"
FINAL_PU, FINAL = "M01", "M05"
"""Functions that show the reference in effect, from any source."""

FULL_SCALE = 20000
"""Value of S01, M01 and M06 at the maximum frequency."""

HUNDREDTH_HZ, STEP_PU = Decimal("0.01"), Decimal("0.005")
"""One step of S05 and M05 in hertz, of S01 and M01 in per cent of the maximum frequency."""

FORWARD, REVERSE, RESET = 0x0001, 0x0002, 0x8000
RUN = FORWARD | REVERSE

_WRITE_RIGHT = ("keypad", "RS-485", "field bus")


def control_profile() -> ControlProfile:
    """Return the control profile; its file is read for commands only, not for reads of functions."""
    return profiles.control_profile("fuji")


def flags_of(word: int, profile: Profile) -> tuple[str, ...]:
    """Return the names of the set bits of M14; only G11S distinguishes the write right in bits 13 and 14."""
    names = [*control_profile().flags_of(word)]
    right = word >> 13 & 3
    if profile.name == "g11s":
        names.append(f"WR {_WRITE_RIGHT[right]}" if right < len(_WRITE_RIGHT) else "WR 3")
    elif right:
        names.append(f"WR {right}")
    return tuple(names)


def command_flags(word: int, profile: Profile) -> tuple[str, ...]:
    """Return the names of the set bits of the operation command; a bit without a name has its number."""
    places = {"FWD": 0, "REV": 1, **profile.terminals, **profile.shown_bits, "RST": 15}
    names = {place: name for name, place in places.items()}
    return tuple(names.get(place, f"bit {place}") for place in range(16) if word >> place & 1)


def word_text(format_name: str, word: int, profile: Profile, faults: Mapping[int, str]) -> str:
    """Return the meaning of a word of this format; empty if the number is all of it."""
    if format_name == "[10]":
        return faults.get(word, "") if word else "no alarm"
    if format_name == "[14]":
        return ", ".join(command_flags(word, profile)) or "none"
    if format_name == "[15]":
        return ", ".join(f"Y{place + 1}" for place in range(5) if word >> place & 1) or "none"
    if format_name == "[16]":
        return ", ".join(flags_of(word, profile)) or "none"
    if format_name == "[17]":
        return "type {}, generation {}, series {}, voltage {}".format(*f"{word:04X}")
    if format_name == "[18]":
        return "data 4: {}, data 3: {}, data 2: {}, data 1: {}".format(*f"{word:04X}")
    if format_name == "[20]":
        return error_text(word) if word else "no error"
    if format_name in ("[21]", "12"):
        return _tuning_text(word)
    return str(TABLES["run_sources"].get(str(word), "")) if format_name == "[67]" else ""


def _tuning_text(word: int) -> str:
    directions = [name for place, name in ((8, "forward"), (9, "reverse")) if word >> place & 1]
    return ", ".join([f"data {word & 0xFF}", *directions])


_WORD = 0x10000


@dataclass(frozen=True, slots=True, kw_only=True)
class Format:
    """One data format.

    known: whether its table is known; a value of an unknown format is the plain number. factor: physical value of one
    step, for formats with steps. signed: two's complement. special: the way to read and write a format without steps.
    """

    name: str
    meaning: str
    factor: Decimal = Decimal(1)
    signed: bool = False
    known: bool = True
    special: str = ""

    def value(self, data: int, *, negative: bool = False) -> int | Decimal:
        """Return the physical value of a word. Raises ValueError for a word that has none.

        negative: whether the sign character is before the digits, which are then a magnitude in every format.
        """
        if self.special:
            value = _SPECIAL[self.special][0](data)
            return -value if negative else value
        if negative:
            return scaled(-data, self.factor)
        return scaled(data - _WORD if self.signed and data >= _WORD // 2 else data, self.factor)

    def raw(self, value: Decimal, parameter: str, unit: str = "") -> int:
        """Return the word for a physical value. Raises ValueRefusedError for a value that has none."""
        if self.special:
            try:
                return _SPECIAL[self.special][1](value)
            except ValueError as error:
                raise ValueRefusedError(f"{value} for parameter {parameter}: {error}; it is not rounded") from None
        lowest, highest = (-_WORD // 2, _WORD // 2 - 1) if self.signed else (0, _WORD - 1)
        if not lowest * self.factor <= value <= highest * self.factor:
            limits = f"{scaled(lowest, self.factor)} to {scaled(highest, self.factor)}"
            raise ValueRefusedError(f"{value} for parameter {parameter} is outside {limits}, what its format can hold")
        return unscaled(value, self.factor, parameter, unit) % _WORD


PLAIN = Format(name="", meaning="not known")
"""The plain number, for functions of unknown format."""


def format_named(name: str | int, *, e11s: bool) -> Format:
    """Return a format by its name; a number without brackets refers to the table of the drive's generation.

    Raises UsageError for a format that no table lists.
    """
    text = str(name)
    if not text:
        return PLAIN
    shown = text if e11s or text.startswith("[") else f"[{text}]"
    if shown not in FORMATS:
        raise UsageError(f"{text!r} is not a data format; they are {', '.join(FORMATS)}")
    return FORMATS[shown]


def current_format(rating_hp: int | None) -> Format:
    """Return format [19] for an inverter of this rating; without a rating it is unknown."""
    if rating_hp is None:
        return replace(FORMATS["[19]"], known=False)
    return replace(FORMATS["[19]"], factor=Decimal("0.01") if rating_hp < 40 else Decimal("0.1"))


def format_of(function: str, name: str | int, options: FujiOptions) -> Format:
    """Return the data format of this name, as this inverter uses it for a function."""
    chosen = format_named(name, e11s=options.generation.e11s_formats)
    if chosen.name == "[19]":
        return current_format(options.rating_hp)
    if function == "M12" and chosen.factor != 1:
        return replace(chosen, factor=exact(options.m12_factor, function))
    return chosen


_SMALL_FACTORS = tuple(Decimal(factor) for factor in ("0.01", "0.1", "1", "10"))


def _time_value(data: int) -> Decimal:
    """Return the value of a word in format [12]: bit 15 sign, 14-12 zero, 11-10 exponent, 9-0 mantissa."""
    if data & 0x7000:
        raise ValueError(f"bits 14 to 12 of {data:04X} are not zero")
    value = (data & 0x3FF) * _SMALL_FACTORS[data >> 10 & 3]
    return -value if data & 0x8000 else value


def _time_raw(value: Decimal) -> int:
    """Return the word with the smallest exponent that fits; mantissa 1 to 999, from x0.1 on 100 to 999."""
    for exponent, factor in enumerate(_SMALL_FACTORS):
        mantissa = _steps(abs(value), factor, range(1 if exponent == 0 else 100, 1000))
        if mantissa is not None:
            return (0x8000 if value < 0 else 0) | exponent << 10 | mantissa
    raise ValueError("format [12] holds three digits, 0.01 to 9990")


def _floating(lowest: str) -> tuple[Callable[[int], Decimal], Callable[[Decimal], int]]:
    """Return reader and writer of formats [24] and [45]: bits 15-14 exponent, 13-0 mantissa of at most 9999.

    lowest: the step for an exponent of 0.
    """
    factors = tuple(Decimal(lowest).scaleb(exponent) for exponent in range(4))

    def raw(value: Decimal) -> int:
        for exponent, factor in enumerate(factors):
            mantissa = _steps(value, factor, range(10_000))
            if mantissa is not None:
                return exponent << 14 | mantissa
        raise ValueError(f"its format holds four digits, {lowest} to {9999 * factors[-1]}")

    return lambda data: (data & 0x3FFF) * factors[data >> 14], raw


def _steps(value: Decimal, factor: Decimal, allowed: range) -> int | None:
    """Return the number of steps of this factor that gives exactly this value; None if no allowed number does."""
    if not allowed[0] * factor <= value <= allowed[-1] * factor:
        return None
    number = int(value / factor)
    return number if number * factor == value else None


def _whole(value: Decimal) -> int:
    if not 0 <= value < _WORD or value != int(value):
        raise ValueError("it is not a whole number from 0 to 65535")
    return int(value)


def _poles_raw(value: Decimal) -> int:
    number = _whole(value)
    if number % 2:
        raise ValueError("it is not an even number, and poles come in pairs")
    return number


def _tuning_raw(value: Decimal) -> int:
    """Return the word for a value of format [21] or FVR-E11S 12, in which bits 8 and 9 are the directions."""
    number = _whole(value)
    if number & 0x300 == 0x300:
        raise ValueError("forward and reverse together have no effect")
    return number


_SPECIAL: Mapping[str, tuple[Callable[[int], int | Decimal], Callable[[Decimal], int]]] = {
    "code": (int, _whole),
    "poles": (int, _poles_raw),
    "tuning": (int, _tuning_raw),
    "digits": (_time_value, _time_raw),
    "floating 0.01": _floating("0.01"),
    "floating 0.001": _floating("0.001"),
}

FORMATS = {name: Format(name=name, **each) for name, each in TABLES["formats"].items()}
