"""Conditions of alarm rules, judged by the state of a drive or by a value. No I/O, no clock."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from decimal import Decimal
from math import isfinite
from typing import TYPE_CHECKING

from drivecomm.line import FRESH

if TYPE_CHECKING:
    from drivecomm.server import CurrentValue, DriveDrift, DriveSnapshot
    from drivecomm.server.alarms.rules import AlarmLimit, Watched


@dataclass(frozen=True, slots=True, kw_only=True)
class ConditionFinding:
    """The result of checking a condition. holds: None if not known now. which: the fault, if there can be several.

    lingers: the condition holds only because the value has not returned by the hysteresis, so its text is not a cause.
    """

    holds: bool | None
    text: str
    which: str = ""
    lingers: bool = False


def check_drive(on: Watched, state: DriveSnapshot) -> ConditionFinding:
    """Check a drive's state: its fault, its warning, its silence, its parameters."""
    if on == "changed_since_baseline":
        return _of_drift(state.drift)
    if state.late:
        return ConditionFinding(holds=None, text="the line is late and has not polled the drive")
    if on == "silent":
        if state.reachability == "asking":
            return ConditionFinding(holds=None, text="it has not been polled yet")
        if state.reachability == "silent":
            return ConditionFinding(
                holds=True, text=f"does not answer: {state.error}" if state.error else "does not answer"
            )
        return ConditionFinding(holds=False, text="answers")
    status = state.status
    if status is None:
        return ConditionFinding(holds=None, text="the drive does not answer")
    if on == "fault":
        if status.fault or state.fault:
            which = (state.fault or status.fault_text).removeprefix("fault").strip()
            # The fault may have gone between the status and its code: code 0 is not another fault.
            return ConditionFinding(
                holds=True, text=f"fault {which}".rstrip(), which="" if status.fault_code == 0 else which
            )
        return ConditionFinding(holds=False, text="no fault")
    if status.warning is None:
        return ConditionFinding(holds=None, text="the status does not report warnings")
    return ConditionFinding(holds=status.warning, text="a warning is active" if status.warning else "no warning")


def _of_drift(drift: DriveDrift) -> ConditionFinding:
    """Check the result of a drive's last comparison with its baseline, whatever its line does now."""
    if drift.state in ("not comparable", "not compared"):
        return ConditionFinding(holds=None, text=str(drift))
    if drift.state in ("as approved", "no baseline"):
        return ConditionFinding(holds=False, text=str(drift))
    # A later change must raise the alarm again, because the acknowledgement was for earlier ones.
    latest_s = max([drift.replaced_since_s or 0.0, *(each.since_s for each in drift.changes)])
    latest = datetime.fromtimestamp(latest_s, UTC)
    return ConditionFinding(holds=True, text=str(drift), which=f"changed at {latest:%Y-%m-%dT%H:%M:%SZ}")


def check_value(limit: AlarmLimit, value: CurrentValue, *, before: bool) -> ConditionFinding:
    """Check a value against a limit. before: whether it was beyond the limit when it was last known."""
    reading = value.reading
    if reading is None or value.quality not in FRESH:
        return ConditionFinding(
            holds=None, text=f"{limit.quantity} is {value.quality}" + f": {value.cause}" * bool(value.cause)
        )
    number = reading.value
    if isinstance(number, str) or not (number.is_finite() if isinstance(number, Decimal) else isfinite(number)):
        return ConditionFinding(holds=None, text=f"{limit.quantity} is {number}, which is not a number")
    unit = f" {reading.unit}" * bool(reading.unit)
    holds = limit.passed(number, before=before)
    where = f"{limit.side} {limit.at}{unit}"
    lingers = holds and not limit.passed(number, before=False)
    if not holds:
        where = f"no longer {where}" if before else f"not {where}"
    elif lingers:
        where = f"not yet back by {limit.hysteresis}{unit} from {limit.at}{unit}"
    return ConditionFinding(holds=holds, text=f"{limit.quantity} is {number}{unit}, {where}", lingers=lingers)
