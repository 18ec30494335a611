"""Control word and status word, in the FC profile and in PROFIdrive.

Specification, section 12; VLT 5000 Design Guide p. 88-95; FC 300 Design Guide, early edition p. 277-289; VLT 6000 HVAC
manual p. 162-165; VLT 5000 PROFIBUS manual MG.90.D1.02 p. 18-30 (PROFIdrive).

A word without bit 10 is ignored by the drive as a whole: that is how parameters are read without touching the motor.
047FH is "start" in PROFIdrive and "start with preset 4" in the FC profile.
"""

from __future__ import annotations

IGNORED = 0x0000

DC_BRAKE_BIT, COAST_BIT, QUICK_STOP_BIT, HOLD_BIT, START_BIT = 2, 3, 4, 5, 6
"""Bits of the FC profile that stop when they are 0."""
RESET_BIT, JOG_BIT, RAMP_2_BIT, VALID_BIT, RELAY_1_BIT, RELAY_2_BIT, SET_UP_BIT, REVERSE_BIT = (
    7,
    8,
    9,
    10,
    11,
    12,
    13,
    15,
)
"""Bits of the FC profile that act when they are 1; the set-up has two."""
ON_BIT, OFF2_BIT, OFF3_BIT, JOG_1_BIT, JOG_2_BIT, SLOW_DOWN_BIT, CATCH_UP_BIT = 0, 1, 2, 8, 9, 11, 12
"""Bits that PROFIdrive uses in another way."""

START = 0x047C
RAMP_STOP = 0x043C
COAST = 0x0474
QUICK_STOP = 0x046C
DC_BRAKE = 0x0478
HOLD = 0x045C
RESET = 0x04BC

PROFIDRIVE_READY = 0x047E
PROFIDRIVE_START = 0x047F
PROFIDRIVE_RAMP_STOP = 0x043F
PROFIDRIVE_COAST = 0x0477
PROFIDRIVE_QUICK_STOP = 0x046F
PROFIDRIVE_HOLD = 0x045F
PROFIDRIVE_STANDSTILL = 0x043E
PROFIDRIVE_RESET = 0x04BE

HUNDRED_PERCENT = 16384
"""4000H: reference and actual value, signed (V5 p. 93; FC 101 guide MG18C822 section 7.11.3)."""

CONTROL_READY, DRIVE_READY, ENABLED, TRIP = 0, 1, 2, 3
FAULT_WITHOUT_TRIP, TRIP_LOCK, WARNING, AT_REFERENCE, BUS_CONTROL, IN_LIMITS, RUNNING = 4, 6, 7, 8, 9, 10, 11

_COMMON_FLAGS = {
    CONTROL_READY: "control ready",
    DRIVE_READY: "drive ready",
    ENABLED: "enabled",
    TRIP: "trip",
    WARNING: "warning",
    AT_REFERENCE: "speed equals reference",
    BUS_CONTROL: "bus control possible",
    IN_LIMITS: "frequency within limits",
    RUNNING: "running",
    12: "stopped by temperature, will restart itself",
    13: "DC link voltage outside limits",
    14: "torque or current limit exceeded",
    15: "thermal timer above 100 %",
}

FLAGS = _COMMON_FLAGS | {FAULT_WITHOUT_TRIP: "error without trip", 5: "bit 5, reserved", TRIP_LOCK: "trip lock"}
"""Status bits of the FC profile; 4 and 6 are reserved on VLT drives."""

# Which level of bits 4 and 5 means OFF differs between VLT and FC drives, so they are named and not interpreted.
PROFIDRIVE_FLAGS = _COMMON_FLAGS | {4: "bit 4 (OFF2)", 5: "bit 5 (OFF3)", 6: "start not possible"}


def has(word: int, bit: int) -> bool:
    """Tell whether a bit is set."""
    return bool(word >> bit & 1)


def flags_of(word: int, *, profidrive: bool) -> tuple[str, ...]:
    """Return the names of the set bits of a status word."""
    return tuple(name for bit, name in sorted((PROFIDRIVE_FLAGS if profidrive else FLAGS).items()) if has(word, bit))


def tripped(status: int, *, profidrive: bool) -> bool:
    """Tell whether a status word says that the drive has tripped; bit 6 is the trip lock in the FC profile only."""
    return has(status, TRIP) or (has(status, TRIP_LOCK) and not profidrive)


_RULES = (
    (VALID_BIT, False, "ignored"),
    (COAST_BIT, False, "coast"),
    (QUICK_STOP_BIT, False, "quick_stop"),
    (DC_BRAKE_BIT, False, "dc_brake"),
    (RESET_BIT, True, "reset"),
    (START_BIT, False, "ramp_stop"),
    (HOLD_BIT, False, "freeze_output"),
    (JOG_BIT, True, "jog"),
)
_PROFIDRIVE_RULES = (
    (VALID_BIT, False, "ignored"),
    (OFF2_BIT, False, "coast"),
    (COAST_BIT, False, "coast"),
    (OFF3_BIT, False, "quick_stop"),
    (QUICK_STOP_BIT, False, "quick_stop"),
    (RESET_BIT, True, "reset"),
    (ON_BIT, False, "ramp_stop"),
    (START_BIT, False, "ramp_stop"),
    (HOLD_BIT, False, "freeze_output"),
    (JOG_1_BIT, True, "jog"),
    (JOG_2_BIT, True, "jog_2"),
)


def command_of(word: int) -> str:
    """Name an FC-profile control word by the first rule that fits (specification, section 14).

    The order only names words; which stop wins inside a drive is printed nowhere.
    """
    return next((name for bit, level, name in _RULES if has(word, bit) is level), "start")


def profidrive_command_of(word: int) -> str:
    """Name a PROFIdrive control word in the same way: OFF2 coasts, OFF3 stops quickly, OFF1 ramps down."""
    return next((name for bit, level, name in _PROFIDRIVE_RULES if has(word, bit) is level), "start")


def lets_run(word: int, *, profidrive: bool) -> bool:
    """Tell whether a control word lets a motor run."""
    name = profidrive_command_of(word) if profidrive else command_of(word)
    return name in ("start", "freeze_output", "jog", "jog_2")
