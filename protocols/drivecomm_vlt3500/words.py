"""The profile of a VLT, and those bits of its control word that are used outside of the profile.

Control word: VLT Series 3500 manual, printed page 87 (bits 0 to 4), page 91 (start); VLT 3000 manual MG.30.A7.02, page
75, and VLT 2000 manual, page 37 (names of bits 5 to 15). Effects of bits 5, 7, 11, 12 and the order of the set-up bits
are those of later drives with the same profile. Status word: VLT 3000 manual, page 78 (bits 0 to 8), VLT 3500 manual,
page 91, VLT 2000 manual, page 36 (the rest).

Every telegram carries a control word. A drive obeys it only if bit 10 is 1, so a word without that bit commands
nothing; bit 10 alone (0x0400) is a command to stop in every way simultaneously.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm import profiles

if TYPE_CHECKING:
    from drivecomm.profiles import ControlProfile

# Bits of the control word.
ON1, ON2, ON3, NO_COAST, RAMP, RAMP_ENABLED, START, RESET = (1 << bit for bit in range(8))
JOG_1, JOG_2, VALID, SLOW_DOWN, CATCH_UP, SETUP_LOW, SETUP_HIGH, REVERSE = (1 << bit for bit in range(8, 16))
SETUP = SETUP_LOW | SETUP_HIGH

IDLE = 0x0000


def profile() -> ControlProfile:
    """Return the control profile; its file is read only when a drive is commanded, not when a parameter is read."""
    return profiles.control_profile("vlt3500")
