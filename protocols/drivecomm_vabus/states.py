"""Control word (parameter 410), state word (parameter 411), and the state machine between them: DRIVECOM.

Agile Modbus manual VEC 691 p. 70; ACT/ACU Modbus manual VEC 383 p. 72.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm import profiles

if TYPE_CHECKING:
    from drivecomm.profiles import ControlProfile

DISABLE_VOLTAGE = 0x0000
VOLTAGE_BIT, WARNING_BIT, REMOTE_BIT, REACHED_BIT = 4, 7, 9, 10

CONTROL_WORD = 410
STATE_WORD = 411
LOCAL_REMOTE = 412
CURRENT_FAULT = 260

STATE_MACHINE = 1
"""Parameter 412: the control word commands; with 2 its bits 0 to 5 are contacts, other values are in no page."""


def profile() -> ControlProfile:
    """Return the control profile; read from its file by who commands a drive, and not by who reads a parameter."""
    return profiles.control_profile("drivecom")
