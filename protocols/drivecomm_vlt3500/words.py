"""Control word and status word: their bits, and the words worth having by name.

Control word: VLT Series 3500 manual, printed page 87 (bits 0 to 4), page 91 (start); VLT 3000 manual MG.30.A7.02, page
75, and VLT 2000 manual, page 37 (names of bits 5 to 15). Effects of bits 5, 7, 11, 12 and the order of the set-up bits
are those of later drives with the same profile. Status word: VLT 3000 manual, page 78 (bits 0 to 8), VLT 3500 manual,
page 91, VLT 2000 manual, page 36 (the rest).

Every telegram carries a control word. A drive looks at it only when bit 10 is 1, so a word without that bit commands
nothing; bit 10 alone (0x0400) is a command to stop in every way at once.
"""

from __future__ import annotations

from drivecomm.protocol import DriveState, DriveStatus

# Bits of the control word.
ON1, ON2, ON3, NO_COAST, RAMP, RAMP_ENABLED, START, RESET = (1 << bit for bit in range(8))
JOG_1, JOG_2, VALID, SLOW_DOWN, CATCH_UP, SETUP_LOW, SETUP_HIGH, REVERSE = (1 << bit for bit in range(8, 16))

IDLE = 0x0000
IDLE_UNLIKE_ANY_STATUS = 0x000F
"""No status word has bits 0 to 3 all at 1: ready and tripped exclude each other."""

STARTED = 0x047F
RAMP_STOP = STARTED & ~START  # 0x043F
OFF1 = STARTED & ~ON1  # 0x047E, also the first step of the start-inhibit release
OFF2 = STARTED & ~ON2  # 0x047D, coast
OFF3 = STARTED & ~ON3  # 0x047B, quick stop
BIT_4_STOP = STARTED & ~RAMP  # 0x046F, quick stop or, where parameter 514 says so, DC brake
START_WITH_RESET = STARTED | RESET  # 0x04FF
START_REVERSE = STARTED | REVERSE  # 0x847F

# Bits of the status word.
(
    CONTROL_READY,
    DRIVE_READY,
    ENABLED,
    TRIPPED,
    OFF2_ACTIVE,
    OFF3_ACTIVE,
    START_NOT_POSSIBLE,
    WARNING,
    AT_REFERENCE,
    BUS_CONTROL,
    IN_RANGE,
    RUNNING,
    OVERLOAD,
    VOLTAGE,
    CURRENT,
    TIMERS,
) = (1 << bit for bit in range(16))

STATUS_NAMES = (
    "control ready",
    "drive ready",
    "enabled",
    "tripped",
    "OFF2",
    "OFF3",
    "start not possible",
    "warning",
    "speed equals the reference",
    "bus control",
    "frequency in range",
    "running",
    "stopped by overload",
    "voltage outside its limits",
    "current limit exceeded",
    "thermal timer above 100 %",
)


def flags_of(status: int) -> tuple[str, ...]:
    """Return the names of the bits that are 1 in a status word."""
    return tuple(name for bit, name in enumerate(STATUS_NAMES) if status >> bit & 1)


def setup_bits(setup: int) -> int:
    """Return bits 13 and 14 of the control word for set-up 1 to 4: 13 is the low bit (order of later drives)."""
    return (setup - 1) * SETUP_LOW


def meaning(word: int, code: int | None, text: str) -> DriveStatus:
    """Return what a status word says; the code and text of a fault come from elsewhere, it has none."""
    running, tripped = bool(word & RUNNING), bool(word & TRIPPED)
    ready = word & CONTROL_READY and word & DRIVE_READY and not word & START_NOT_POSSIBLE
    if tripped:
        state = DriveState.FAULT
    elif running:
        state = DriveState.STOPPING if word & OFF3_ACTIVE else DriveState.RUNNING
    else:
        state = DriveState.READY if ready else DriveState.NOT_READY
    return DriveStatus(
        word=word,
        state=state,
        running=running,
        fault=tripped,
        warning=bool(word & WARNING),
        at_reference=bool(word & AT_REFERENCE),
        remote=bool(word & BUS_CONTROL),
        fault_code=code,
        fault_text=text,
        flags=flags_of(word),
    )
