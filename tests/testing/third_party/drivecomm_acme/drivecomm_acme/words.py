"""Control word and status word of an Acme drive, A10 line manual, section 4; codes of refusals, section 3.4."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.protocol import DriveState, DriveStatus

if TYPE_CHECKING:
    from collections.abc import Mapping

RUN, REVERSE, RESET, COAST, QUICK = 0x01, 0x02, 0x04, 0x08, 0x10
RUNNING, BACKWARDS, FAULT, AT_REFERENCE, STOPPING = 0x0001, 0x0002, 0x0004, 0x0008, 0x0010

UNKNOWN, READ_ONLY, OUT_OF_RANGE, RUNS, IN_FAULT = 1, 2, 3, 4, 5
REFUSALS = {
    UNKNOWN: "unknown parameter",
    READ_ONLY: "read only",
    OUT_OF_RANGE: "value out of range",
    RUNS: "not while the motor runs",
    IN_FAULT: "not while a fault is active",
}

_FLAGS = {
    RUNNING: "output on",
    BACKWARDS: "turning backwards",
    FAULT: "fault",
    AT_REFERENCE: "at reference",
    STOPPING: "quick stop",
}


def status(word: int, fault_code: int, faults: Mapping[int, str]) -> DriveStatus:
    """Return the status that a status word and a fault code mean. faults: texts by code."""
    running, fault = bool(word & RUNNING), bool(word & FAULT)
    state = DriveState.RUNNING if running else DriveState.READY
    if word & STOPPING:
        state = DriveState.STOPPING
    return DriveStatus(
        word=word,
        state=DriveState.FAULT if fault else state,
        running=running,
        fault=fault,
        reverse=bool(word & BACKWARDS),
        at_reference=bool(word & AT_REFERENCE),
        fault_code=fault_code if fault else None,
        fault_text=faults.get(fault_code, "") if fault else "",
        flags=tuple(name for bit, name in _FLAGS.items() if word & bit),
    )
