"""Control word and status word of PROFIdrive on USS (USS specification C-26 to C-31; NORD BU 0050 p. 37).

A control word without bit 10 is not valid: older drives keep the process data they have, MICROMASTER 4 counts it
towards its telegram off time (CU240 Operating Instructions 03/2009 p. 160), and a running G120 trips with F07220 (G110M
Function Manual 01/2016 p. 119).
"""

from __future__ import annotations

from drivecomm.protocol import DriveState, Stop

READY, RUN, ACKNOWLEDGE = 0x047E, 0x047F, 0x04FE
STOP_WORDS = {Stop.RAMP: READY, Stop.COAST: 0x047C, Stop.QUICK: 0x047A}
"""OFF1; OFF2 and OFF3 together with OFF1, so that what follows them is no start."""

ON, OFF2, OFF3, ENABLE, RAMP, RAMP_GOES, SETPOINT, ACKNOWLEDGE_BIT, VALID = 0, 1, 2, 3, 4, 5, 6, 7, 10
ENABLED, FAULT, NO_OFF2, NO_OFF3, INHIBIT, WARNING, AT_SETPOINT, REMOTE = 2, 3, 4, 5, 6, 7, 8, 9
HUNDRED_PERCENT = 0x4000

FLAGS = (
    "ready to switch on", "ready", "operation enabled", "fault", "no OFF2", "no OFF3", "switch-on inhibit", "alarm",
    "at setpoint", "control requested", "f or n reached", "bit 11", "bit 12", "bit 13", "bit 14", "bit 15",
)  # fmt: skip


def has(word: int, bit: int) -> bool:
    """Tell whether a bit is set."""
    return bool(word >> bit & 1)


def lets_run(word: int) -> bool:
    """Tell whether a control word lets the motor run."""
    return all(has(word, bit) for bit in (ON, OFF2, OFF3, ENABLE, VALID))


def state_of(status: int) -> DriveState:
    """Return the state that a status word means, by the table of NORD p. 37."""
    if has(status, FAULT):
        return DriveState.FAULT
    if has(status, INHIBIT) or not has(status, 0):
        return DriveState.NOT_READY
    if has(status, ENABLED):
        return DriveState.RUNNING if has(status, NO_OFF3) else DriveState.STOPPING
    return DriveState.READY
