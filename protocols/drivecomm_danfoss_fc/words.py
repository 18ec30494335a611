"""Bits of control word and status word, in the FC profile and in PROFIdrive; the profiles define their commands.

Specification, section 12; VLT 5000 Design Guide p. 88-95; FC 300 Design Guide, early edition p. 277-289; VLT 6000 HVAC
manual p. 162-165; VLT 5000 PROFIBUS manual MG.90.D1.02 p. 18-30 (PROFIdrive).

The drive ignores a word without bit 10 as a whole, so that parameters can be read without an effect on the motor.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm import profiles

if TYPE_CHECKING:
    from drivecomm.profiles import ControlProfile

IGNORED = 0x0000

DC_BRAKE_BIT, COAST_BIT, QUICK_STOP_BIT, HOLD_BIT, START_BIT = 2, 3, 4, 5, 6
"""Bits of the FC profile that stop the motor when they are 0."""
RESET_BIT, JOG_BIT, RAMP_2_BIT, VALID_BIT, RELAY_1_BIT, RELAY_2_BIT, SET_UP_BIT, REVERSE_BIT = (*range(7, 14), 15)
"""Bits of the FC profile that act when they are 1; the set-up has two."""
ON_BIT, OFF2_BIT, OFF3_BIT, JOG_1_BIT, JOG_2_BIT, SLOW_DOWN_BIT, CATCH_UP_BIT = 0, 1, 2, 8, 9, 11, 12
"""Bits that PROFIdrive uses in another way."""

PRESET_MASK, RAMP_MASK, SET_UP_MASK = 0b11, 1 << RAMP_2_BIT, 0b11 << SET_UP_BIT
FUNCTIONS_MASK = PRESET_MASK | RAMP_MASK | SET_UP_MASK | 1 << RELAY_1_BIT | 1 << RELAY_2_BIT
"""Bits that select functions and belong to no single command; in PROFIdrive only those of the set-up."""

CONTROL_READY, DRIVE_READY, ENABLED, TRIP = 0, 1, 2, 3
FAULT_WITHOUT_TRIP, TRIP_LOCK, WARNING, AT_REFERENCE, BUS_CONTROL, IN_LIMITS, RUNNING = 4, 6, 7, 8, 9, 10, 11


def profile(*, profidrive: bool) -> ControlProfile:
    """Return the control profile; its file is read for commands only, not for reads of parameters."""
    return profiles.control_profile("danfoss-profidrive" if profidrive else "danfoss-fc")


def has(word: int, bit: int) -> bool:
    """Return whether a bit is set."""
    return bool(word >> bit & 1)
