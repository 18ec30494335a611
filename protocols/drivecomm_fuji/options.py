"""Options for the differences between Fuji inverters."""

from __future__ import annotations

from dataclasses import dataclass, fields
from decimal import Decimal

from drivecomm.errors import UsageError
from drivecomm.protocol import exact
from drivecomm_fuji.generations import DEFAULT_PROFILE, PROFILES, Profile, ProfileName, SlowWrite

QUICK_TIMEOUT_S = 0.1
"""Reply timeout for R, E, a-k, m, A, and W of S codes; a common value of the family that no known page states."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FujiOptions:
    """Options of a Fuji inverter.

    profile: its generation: e11s (FVR-E11S, VXSM), g11s (FRENIC5000 G11S/P11S, AF-300), vg (FRENIC-VG) or frenic (Mini
    to AQUA). Without it, a drive counts as frenic, and a single telegram may be of any generation. number_check: refuse
    function numbers beyond the profile's. short_frames: use the optional frames if there is one for the function.
    high_speed_writes: write with command A, which is answered before the value is stored. signed_j: the reply to
    optional frame j is signed; without this option it is a magnitude. m12_factor: volts in one step of M12, 0.1 or 1.
    rating_hp: rating of the inverter, which scales currents (0.01 A up to 30 HP, 0.1 A from 40 HP).
    maximum_frequency_hz: F03 of an inverter whose S05 is not a frequency (vg), so that a frequency can be sent as S01.
    s06_mask: bits of S06 that exist, instead of the profile's. coast_terminal: terminal (X1...) whose function E01...
    is set to coast to a stop; `stop` can coast only with it. reference_read_back: read the final reference (M05, M01)
    after setting one, and raise StateError if it differs; not for an inverter that shows none at standstill.

    response_interval_s: the inverter's own delay before it answers (y09, y19, H39), added to every reply timeout.
    write_timeout_s: for W of functions other than S codes. motor_data_timeout_s: for H03 = 2 and P02.
    initialise_timeout_s: for H03 = 1. tuning_timeout_s: for P04 and A13. busy_repeats, busy_pause_s: how often, and
    after what time, a write that got code 81 is repeated. reset_timeout_s: how long an alarm may take to disappear
    after a reset.
    """

    profile: ProfileName | None = None
    number_check: bool = True
    short_frames: bool = False
    high_speed_writes: bool = False
    signed_j: bool = False
    m12_factor: Decimal | str = Decimal("0.1")
    rating_hp: int | None = None
    maximum_frequency_hz: Decimal | int | str | None = None
    s06_mask: int | None = None
    reference_read_back: bool = True
    coast_terminal: str = ""
    response_interval_s: float = 0.0
    write_timeout_s: float = 0.5
    motor_data_timeout_s: float = 1.0
    initialise_timeout_s: float = 10.0
    tuning_timeout_s: float = 300.0
    busy_repeats: int = 10
    busy_pause_s: float = 0.1
    reset_timeout_s: float = 1.0

    def __post_init__(self) -> None:
        if self.coast_terminal and self.coast_terminal not in self.generation.terminals:
            known = ", ".join(self.generation.terminals)
            raise UsageError(f"{self.generation.title} has no terminal {self.coast_terminal!r}; it has {known}")
        if exact(self.m12_factor, "M12") <= 0:
            raise UsageError(f"m12_factor of {self.m12_factor} is not positive")
        if self.maximum_frequency_hz is not None and exact(self.maximum_frequency_hz, "F03") <= 0:
            raise UsageError(f"maximum_frequency_hz of {self.maximum_frequency_hz} is not positive")
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name.endswith(("_s", "_repeats", "_mask")) and value is not None and value < 0:
                raise UsageError(f"{field.name} of {value} is negative")

    @property
    def generation(self) -> Profile:
        """Profile of a drive with these options."""
        return PROFILES[self.profile or DEFAULT_PROFILE]

    def reply_timeout(self, write: SlowWrite | None = None) -> float | None:
        """Return the reply timeout in seconds, also of a slow write; None for the drive's own."""
        if write is not None:
            timeout: float = getattr(self, write.timeout)
            return timeout + self.response_interval_s
        return QUICK_TIMEOUT_S + self.response_interval_s if self.response_interval_s else None
