"""Tables of the manuals, from tables.toml, which names the pages: generations of inverters, errors, slow writes.

The durations of writes are common values of the family (section 10 of the specification); no known page states them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeAlias

from drivecomm.protocol import tables_beside

if TYPE_CHECKING:
    from collections.abc import Mapping

TABLES = tables_beside(__file__, "tables.toml")

# Communication errors: the code of a NAK, which M26 then holds as well.
CHECKSUM_ERROR, FORMAT_ERROR, COMMAND_ERROR, LINK_PRIORITY = 71, 74, 75, 76
FUNCTION_ERROR, WRITE_DISABLED, DATA_ERROR, WRITE_BUSY = 78, 79, 80, 81
WITHOUT_ECHO = frozenset([FORMAT_ERROR, COMMAND_ERROR])
"""Codes whose NAK need not repeat command and function: FRENIC5000G11S RS-485 manual p. 13, HVAC/AQUA manual 4-5."""

ProfileName: TypeAlias = Literal["e11s", "g11s", "vg", "frenic"]

DEFAULT_PROFILE: ProfileName = "frenic"
"""The profile of a drive on a bus for which none is given."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Profile:
    """Functions and frames that inverters of one generation understand.

    - commands: of the standard frame.
    - types: function type letters.
    - highest_number: of a function.
    - select: letters of the optional selecting frames and the function that each writes, empty for `m`, the alarm
      reset.
    - poll: letters of the optional polling frames and the function that each reads.
    - s05_is_frequency: whether S05 is a frequency in 0.01 Hz.
    - sign_functions: functions whose negative values carry "-" in byte 8 and a magnitude.
    - terminals: the bits of S06 beyond FWD, REV and RST.
    - shown_bits: further bits of the operation command that M13 may show and no master sets.
    - error_codes: NAK and M26 codes.
    - broadcast_functions: functions that W may write at station 99, None for every S code.
    - e11s_formats: whether data formats are numbered as on FVR-E11S.
    - processing_ms: time that the inverter needs for a short reply, in addition to its response interval.
    - checks_route: whether a write gets code 76 if H30 does not give the link the right to it.
    - echoes_writes, nak_filler: the content of a virtual inverter's data field in the ACK of a write, and before an
      error code.
    - baud_rates: rates that can be set.
    - silence: the functions that decide the reaction to a silent host, and whether frames to any_station count; empty
      if there are none.
    """

    name: str
    title: str
    commands: frozenset[str]
    types: str
    highest_number: int
    select: Mapping[str, str]
    poll: Mapping[str, str]
    s05_is_frequency: bool = True
    sign_functions: frozenset[str]
    terminals: Mapping[str, int]
    shown_bits: Mapping[str, int] = field(default_factory=dict)
    error_codes: frozenset[int]
    broadcast_functions: frozenset[str] | None = None
    e11s_formats: bool = False
    processing_ms: int
    checks_route: bool = True
    echoes_writes: bool = False
    nak_filler: str = "  "
    baud_rates: frozenset[int]
    silence: Mapping[str, Any] = field(default_factory=dict)

    @property
    def all_commands(self) -> frozenset[str]:
        """Commands of all frames."""
        return self.commands.union(self.select, self.poll)

    @property
    def command_mask(self) -> int:
        """Bits of S06 that exist: FWD, REV, terminals and RST."""
        return 0x8003 | sum(1 << bit for bit in self.terminals.values())

    def refusal_of(self, function: str, *, number_check: bool) -> str:
        """Return the reason why these inverters have no such function; empty if they may have it."""
        if function[0] not in self.types:
            return f"{self.title} has no functions of type {function[0]!r}; its types are {' '.join(self.types)}"
        if number_check and int(function[1:]) > self.highest_number:
            return (
                f"the functions of {self.title} end at number {self.highest_number:02d}; "
                "number_check=False allows higher ones"
            )
        return ""

    def takes_from_all(self, function: str) -> bool:
        """Return whether this function can be written to all stations in one frame."""
        allowed = self.broadcast_functions
        return function[:1] == "S" and (allowed is None or function in allowed)


def _sets(said: Mapping[str, Any]) -> dict[str, Any]:
    return {key: frozenset(each) if isinstance(each, list) else each for key, each in said.items()}


PROFILES: Mapping[str, Profile] = {
    name: Profile(name=name, **_sets(each)) for name, each in TABLES["generations"].items()
}

FUNCTIONS = frozenset(
    f"{letter}{number:02d}" for profile in PROFILES.values() for letter in profile.types for number in range(100)
)
"""Functions that a generation may have: a type letter, whose case matters, and two digits."""


def error_text(code: int) -> str:
    """Return the manuals' text for an error code; a code that no manual lists is named by its number."""
    return str(TABLES["errors"].get(str(code), f"unlisted error {code}"))


class SlowWrite(NamedTuple):
    """A write that takes long.

    timeout: the name of the option with the reply timeout for it.
    """

    needs_s: float
    timeout: str


def slow_write(function: str, data: int) -> SlowWrite | None:
    """Return the known duration of this write; None if it takes effect immediately."""
    if function[0] == "S":
        return None
    rows = TABLES["slow_writes"]
    known = rows.get(f"{function}={data}") or (rows.get(function) if data else None) or rows["others"]
    return SlowWrite(float(known["needs_s"]), known["timeout"])
