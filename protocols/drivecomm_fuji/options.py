"""What differs between Fuji inverters and is therefore configurable."""

from __future__ import annotations

from dataclasses import dataclass, fields
from decimal import Decimal

from drivecomm.errors import UsageError
from drivecomm.protocol import exact
from drivecomm_fuji.generations import DEFAULT_PROFILE, PROFILES, Profile, ProfileName, SlowWrite

QUICK_TIMEOUT_S = 0.1
"""For R, E, a-k, m, A, and W of S codes; in use for the family, no page that was read has it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FujiOptions:
    """Options of a Fuji inverter.

    profile: its generation: e11s (FVR-E11S, VXSM), g11s (FRENIC5000 G11S/P11S, AF-300), vg (FRENIC-VG) or frenic (Mini
    to AQUA). A drive without one is taken for frenic, a single telegram for any. number_check: refuse function numbers
    beyond the profile's. short_frames: use the optional frames where there is one. high_speed_writes: write with
    command A, which answers before the value is stored. signed_j: the answer to optional frame j is signed; without
    it, it is a magnitude. m12_factor: volts in one step of M12, 0.1 or 1. rating_hp: rating of the inverter, which
    scales currents (0.01 A up to 30 HP, 0.1 A from 40 HP). maximum_frequency_hz: F03 of an inverter whose S05 is no
    frequency (vg), so that a frequency can be given as S01. s06_mask: bits of S06 that exist, instead of the
    profile's. coast_terminal: terminal (X1...) whose function E01... is set to coast to a stop; only then `stop` can
    coast. reference_read_back: ask for the final reference (M05, M01) when one was set, and raise StateError when it is
    another; not for an inverter that shows none in standstill.

    response_interval_s: the inverter's own waiting time before it answers (y09, y19, H39), on top of every reply
    timeout. write_timeout_s: for W of other than S codes. motor_data_timeout_s: for H03 = 2 and P02.
    initialise_timeout_s: for H03 = 1. tuning_timeout_s: for P04 and A13. busy_repeats, busy_pause_s: how often and
    after what time a write is repeated that met code 81. reset_timeout_s: how long an alarm may take to go after a
    reset.
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
        """The profile of a drive with these options."""
        return PROFILES[self.profile or DEFAULT_PROFILE]

    def reply_timeout(self, write: SlowWrite | None = None) -> float | None:
        """Return how long to wait for a reply, also to a slow write; None for the drive's own reply time."""
        if write is not None:
            timeout: float = getattr(self, write.timeout)
            return timeout + self.response_interval_s
        return QUICK_TIMEOUT_S + self.response_interval_s if self.response_interval_s else None
