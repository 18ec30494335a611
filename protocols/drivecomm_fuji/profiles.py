"""The four generations of inverters that speak this protocol, as data.

Each field names its source: "E" is the FVR-E11S manual INR-SI47-0627a-E (or its VXSM75-1 edition), "G" the
FRENIC5000G11S/P11S RS-485 manual, "GT" its technical information, chapter 2, "GU" its US manual, "GX" the GE AF-300
Ethernet manual, "V" the FRENIC-VG option edition 24A7-E-0045, "A" the FRENIC-HVAC/AQUA RS-485 manual 24A7-E-0021a,
"MI", "MM", "MG" and "C" the FRENIC-Mini, MEGA, MEGA G2 and Ace manuals; the number behind it is the page. The page
9-15 of the VXSM150-1 manual is called the seed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Mapping

ProfileName: TypeAlias = Literal["e11s", "g11s", "vg", "frenic"]

DEFAULT_PROFILE: ProfileName = "frenic"
"""The profile of a drive on a bus that names none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Profile:
    """What inverters of one generation understand.

    commands: of the standard frame. types: function type letters. highest_number: of a function. select: letters of
    the optional selecting frames and the function that each writes, empty for `m`, the alarm reset. poll: letters of
    the optional polling frames and the function that each reads. s05_is_frequency: S05 is a frequency in 0.01 Hz.
    sign_functions: functions whose negative values carry "-" in byte 8 and a magnitude. terminals: the bits of S06
    beyond FWD, REV and RST. shown_bits: further bits of the operation command that M13 may show and nobody sets.
    error_codes: NAK and M26 codes. broadcast_functions: what W may write at station 99, None for every S code.
    e11s_formats: data formats are numbered as on FVR-E11S. processing_s: what the inverter needs for a short answer, on
    top of its response interval. checks_route: code 76 when H30 does not give the right. echoes_writes, nak_filler:
    what a virtual inverter puts into the data field of a write ACK, and before the error code. baud_rates: that can be
    set.
    """

    name: ProfileName
    title: str
    commands: frozenset[str]
    types: str
    highest_number: int
    select: Mapping[str, str]
    poll: Mapping[str, str]
    s05_is_frequency: bool = True
    sign_functions: frozenset[str]
    terminals: Mapping[str, int]
    shown_bits: Mapping[str, int]
    error_codes: frozenset[int]
    broadcast_functions: frozenset[str] | None
    e11s_formats: bool = False
    processing_s: float
    checks_route: bool = True
    echoes_writes: bool = False
    nak_filler: bytes = b"  "
    baud_rates: tuple[int, ...]

    @property
    def command_mask(self) -> int:
        """The bits of S06 that exist: FWD, REV, terminals and RST."""
        mask = 0x8003
        for bit in self.terminals.values():
            mask |= 1 << bit
        return mask

    def refusal_of(self, function: str, *, number_check: bool) -> str:
        """Say why these inverters have no such function, nothing when they may have it."""
        if function[0] not in self.types:
            return f"{self.title} has no functions of type {function[0]!r}; its types are {' '.join(self.types)}"
        if number_check and int(function[1:]) > self.highest_number:
            return (
                f"the functions of {self.title} end at number {self.highest_number:02d}; "
                "number_check=False allows higher ones"
            )
        return ""


_SELECT = {"a": "S01", "e": "S05", "f": "S06", "m": ""}
_SELECT_VG = {"a": "S01", "b": "S02", "c": "S03", "d": "S04", "e": "S05", "f": "S06", "m": ""}
_POLL = {"g": "M06", "h": "M07", "i": "M08", "j": "M09", "k": "M14"}
_POLL_FRENIC = {letter: function for letter, function in _POLL.items() if letter != "i"}

_X1_TO_X5 = {f"X{number}": number + 1 for number in range(1, 6)}
_X1_TO_X9 = {f"X{number}": number + 1 for number in range(1, 10)}
_X11_TO_X14 = {f"X{number}": number for number in range(11, 15)}

_ALL_CODES = frozenset(range(71, 82))
_OLD_CODES = _ALL_CODES - {76, 77, 81}

# Meaning of a e f m and g-k: G 11, V 5-24, A 4-7, A 4-9; on FVR-E11S only the letters are printed (E 9-16, 9-17).
PROFILES: Mapping[str, Profile] = {
    "e11s": Profile(
        name="e11s",
        title="FVR-E11S",
        commands=frozenset("RWE"),  # seed
        types="SMFECPHA",  # seed
        highest_number=46,  # seed
        select=_SELECT,  # E 9-16
        poll=_POLL,  # E 9-17
        sign_functions=frozenset(["M09"]),  # E 9-18
        terminals=_X1_TO_X5,  # E 9-20
        shown_bits={},
        error_codes=_OLD_CODES,  # E 9-19
        broadcast_functions=frozenset(["S01", "S05", "S06"]),  # E 9-18: run and frequency commands
        e11s_formats=True,  # E 9-24, 9-27
        processing_s=0.010,  # E 9-13
        checks_route=False,
        echoes_writes=True,  # seed, E 9-19; E 9-18 says "0000"
        nak_filler=b"00",  # not specified
        baud_rates=(1200, 2400, 4800, 9600, 19200),  # E 9-13
    ),
    "g11s": Profile(
        name="g11s",
        title="FRENIC5000 G11S/P11S",
        commands=frozenset("RWAE"),  # G 9
        types="FECPHAoSM",  # G 9
        highest_number=49,  # G 9: tens digit 0 to 4
        select=_SELECT,  # G 11
        poll=_POLL,  # G 13
        sign_functions=frozenset(["M09", "M35"]),  # G 9
        terminals=_X1_TO_X9,  # GX 35
        shown_bits={},
        error_codes=_ALL_CODES,  # GT 2-57
        broadcast_functions=frozenset(f"S{number:02d}" for number in range(1, 7)),  # GT 2-47
        processing_s=0.010,
        baud_rates=(2400, 4800, 9600, 19200),  # GU 9-8
    ),
    "vg": Profile(
        name="vg",
        title="FRENIC-VG",
        commands=frozenset("RWAE"),  # V 5-20; A acts as W
        types="FECPHALUoSM",  # V 5-20
        highest_number=99,  # V 5-20
        select=_SELECT_VG,  # V 5-24
        poll=_POLL,  # V 5-25
        s05_is_frequency=False,  # V 5-24: orientation position
        sign_functions=frozenset(),  # V 5-21
        terminals={**_X1_TO_X9, **_X11_TO_X14},  # V 6-68
        shown_bits={},
        error_codes=_ALL_CODES - {77, 81},  # V 5-27, 5-39
        broadcast_functions=None,  # V 5-19
        processing_s=0.030,  # V 5-11
        baud_rates=(2400, 4800, 9600, 19200, 38400),  # V 5-2
    ),
    "frenic": Profile(
        name="frenic",
        title="FRENIC Mini/Eco/Multi/MEGA/Ace/HVAC/AQUA",
        commands=frozenset("RWAE"),  # A 4-11
        types="FECPHAbrSoMJdULyWXZKT",  # A 3-5
        highest_number=99,  # A 4-4
        select=_SELECT,  # A 4-7
        poll=_POLL_FRENIC,  # A 4-9, 4-11
        sign_functions=frozenset(["M09", "M35"]),  # A 4-4 says "negative data" only; the functions are those of G11S
        terminals={**_X1_TO_X9, "XF": 13, "XR": 14},  # XF and XR are not confirmed
        shown_bits={"EN": 11},  # on some models, not confirmed
        error_codes=_ALL_CODES,  # A 4-17, 5-69; 77 in the table of data formats only
        broadcast_functions=frozenset(
            ["S01", "S05", "S06", "S13", "S14", "S19", "S31", "S32", "S33", "S90", "S91", "S92", "S93"]  # A 3-1
        ),
        processing_s=0.010,  # MM 5-274, A 3-13
        baud_rates=(2400, 4800, 9600, 19200, 38400, 57600, 76800, 115200),  # MI 5-2, MM 9-2, C 9-2, MG 9-2
    ),
}

FUNCTION_TYPES = "".join(dict.fromkeys("".join(profile.types for profile in PROFILES.values())))
"""The function type letters of all generations; the case matters."""
