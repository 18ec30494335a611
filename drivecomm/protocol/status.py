"""The state of a drive and the ways to stop it, in terms that fit every maker."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, Literal, TypeAlias

from drivecomm.errors import UsageError, shortened, suggestion

if TYPE_CHECKING:
    from decimal import Decimal


class Stop(Enum):
    """Way to stop a motor.

    RAMP: down the normal ramp. COAST: output off, the motor runs out. QUICK: down the quick-stop ramp. DC_BRAKE: with
    direct current.
    """

    RAMP = "ramp"
    COAST = "coast"
    QUICK = "quick"
    DC_BRAKE = "dc_brake"


StopName: TypeAlias = Literal["ramp", "coast", "quick", "dc_brake"]
"""The text of a way to stop, which is accepted in place of a `Stop`."""

StateName: TypeAlias = Literal["not_ready", "ready", "running", "stopping", "fault"]
"""The text of a state, which is accepted in place of a `DriveState`."""


def way_to_stop(how: Stop | StopName) -> Stop:
    """Return the way to stop for a `Stop` or its text. Raises UsageError for anything else."""
    try:
        return Stop(how)
    except ValueError:
        known = suggestion(how, [stop.value for stop in Stop], "use")
        raise UsageError(f"unknown way to stop {shortened(how)}; {known}") from None


class DriveState(Enum):
    """Operating state of a drive.

    NOT_READY: cannot start immediately (disabled, switched off, initialising). READY: would start on command; the shaft
    may still turn, and the output frequency shows whether it does. RUNNING: the motor is being driven. STOPPING: a
    quick stop is under way. FAULT: tripped, needs a reset. By CiA 402 (IEC 61800-7-201): NOT_READY is "not ready to
    switch on" and "switch on disabled", READY "ready to switch on" and "switched on", RUNNING "operation enabled",
    STOPPING "quick stop active", FAULT "fault reaction active" and "fault".
    """

    NOT_READY = "not_ready"
    READY = "ready"
    RUNNING = "running"
    STOPPING = "stopping"
    FAULT = "fault"


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveStatus:
    """Status word of a drive and its meaning; a field is None if this drive's word says nothing about it.

    word: the status word as received. state: the one state that it means. running: the motor is being driven. fault:
    tripped. warning: a warning is active. at_reference: speed equals the reference. reverse: the motor turns backwards.
    remote: the bus may command the drive. fault_code, fault_text: code and text of the active fault, if the drive
    reports it. actual_percent: output as a share of the reference range. actual_hz: output frequency. flags: the names
    of the set bits in the manual's words.
    """

    word: int
    state: DriveState
    running: bool
    fault: bool
    warning: bool | None = None
    at_reference: bool | None = None
    reverse: bool | None = None
    remote: bool | None = None
    fault_code: int | None = None
    fault_text: str = ""
    actual_percent: Decimal | None = None
    actual_hz: Decimal | None = None
    flags: tuple[str, ...] = ()

    def __str__(self) -> str:
        """Return the state and other facts that a person looks for: fault, speed, direction, warning, bus control."""
        speed = f"{self.actual_hz} Hz" if self.actual_hz is not None else f"{self.actual_percent} %"
        said = {
            f"{self.fault_code} {self.fault_text}".removeprefix("None").strip(): self.fault,
            speed: self.actual_hz is not None or self.actual_percent is not None,
            "at reference": self.running and self.at_reference,
            "reverse": self.reverse,
            "warning": self.warning,
            "not under bus control": self.remote is False,
        }
        return ", ".join([self.state.value, *(text for text, is_so in said.items() if text and is_so)])
