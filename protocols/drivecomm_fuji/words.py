"""The operation command (S06, M13), the operation status (M14) and other words whose bits or digits have names.

FVR-E11S manual 9-20; GE AF-300 Ethernet manual 35-37; FRENIC-VG manual 6-68; FRENIC-Ace manual 9-39; HVAC/AQUA RS-485
manual 5-73.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm import profiles
from drivecomm_fuji.generations import TABLES, error_text

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.profiles import ControlProfile
    from drivecomm_fuji.generations import Profile

FREQUENCY_PU, FREQUENCY, COMMAND = "S01", "S05", "S06"
STATUS, ALARM, ERROR = "M14", "M16", "M26"
FINAL_PU, FINAL = "M01", "M05"
"""The reference that holds, whatever it comes from."""

FULL_SCALE = 20000
"""S01, M01, M06 at the maximum frequency."""

FORWARD, REVERSE, RESET = 0x0001, 0x0002, 0x8000
RUN = FORWARD | REVERSE

_WRITE_RIGHT = ("keypad", "RS-485", "field bus")


def control_profile() -> ControlProfile:
    """Return the control profile; read from its file by who commands an inverter, and not by who reads a function."""
    return profiles.control_profile("fuji")


def flags_of(word: int, profile: Profile) -> tuple[str, ...]:
    """Return the names of the set bits of M14; the write right of bits 13 and 14 is told apart only on G11S."""
    names = [*control_profile().flags_of(word)]
    right = word >> 13 & 3
    if profile.name == "g11s":
        names.append(f"WR {_WRITE_RIGHT[right]}" if right < len(_WRITE_RIGHT) else "WR 3")
    elif right:
        names.append(f"WR {right}")
    return tuple(names)


def command_flags(word: int, profile: Profile) -> tuple[str, ...]:
    """Return the names of the set bits of the operation command; a bit without a name is given by its number."""
    places = {"FWD": 0, "REV": 1, **profile.terminals, **profile.shown_bits, "RST": 15}
    names = {place: name for name, place in places.items()}
    return tuple(names.get(place, f"bit {place}") for place in range(16) if word >> place & 1)


def word_text(format_name: str, word: int, profile: Profile, faults: Mapping[int, str]) -> str:
    """Return what a word of this format stands for, empty where its number says all."""
    if format_name == "[10]":
        return faults.get(word, "") if word else "no alarm"
    if format_name == "[14]":
        return ", ".join(command_flags(word, profile)) or "none"
    if format_name == "[15]":
        return ", ".join(f"Y{place + 1}" for place in range(5) if word >> place & 1) or "none"
    if format_name == "[16]":
        return ", ".join(flags_of(word, profile)) or "none"
    if format_name == "[17]":
        return "type {:X}, generation {:X}, series {:X}, voltage {:X}".format(*_digits(word))
    if format_name == "[18]":
        return "data 4: {:X}, data 3: {:X}, data 2: {:X}, data 1: {:X}".format(*_digits(word))
    if format_name == "[20]":
        return error_text(word) if word else "no error"
    if format_name in ("[21]", "12"):
        return _tuning_text(word)
    return str(TABLES["run_sources"].get(str(word), "")) if format_name == "[67]" else ""


def _digits(word: int) -> tuple[int, int, int, int]:
    return word >> 12 & 15, word >> 8 & 15, word >> 4 & 15, word & 15


def _tuning_text(word: int) -> str:
    directions = [name for place, name in ((8, "forward"), (9, "reverse")) if word >> place & 1]
    return ", ".join([f"data {word & 0xFF}", *directions])
