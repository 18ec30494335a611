"""Trips a drive each time a condition on one of its parameters begins to be true."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.errors import DriveCommError, UsageError

if TYPE_CHECKING:
    from drivecomm.plant import Condition
    from drivecomm.virtual.line import VirtualLine
    from drivecomm.virtual.planted_drive import PlantedDrive

PERIOD_S = 0.1
"""How often a condition is looked at, in seconds of the process."""

_SHORTEST_S = 0.01
"""The same on the line, however fast the process goes."""


class ConditionWatch:
    """Looks at the parameter while the drive has power. Raises UsageError where it holds no number.

    speed: seconds of the process for each second of the line.
    """

    def __init__(
        self, line: VirtualLine, drive: PlantedDrive, condition: Condition, code: int, *, speed: float
    ) -> None:
        self._line = line
        self._drive = drive
        self._condition = condition
        self._code = code
        self._speed = speed
        self._period_s = max(PERIOD_S / speed, _SHORTEST_S)
        self._true_since: float | None = None
        self._has_tripped = False
        # Refused before it is asked for, lest the drive remembers the refusal as an error.
        drive.peek(condition.parameter, line.time)
        self._value()
        line.call_at(line.time, self._look)

    def _look(self) -> None:
        now = self._line.time
        self._line.call_at(now + self._period_s, self._look)
        if not self._line.has_power(self._drive) or not self._is_met():
            self._true_since = None
            self._has_tripped = False
            return
        if self._true_since is None:
            self._true_since = now
        if not self._has_tripped and (now - self._true_since) * self._speed >= self._condition.for_s:
            self._has_tripped = True
            self._drive.trip(self._code, now)

    def _is_met(self) -> bool:
        try:
            return self._condition.met_by(self._value())
        except DriveCommError:
            return False

    def _value(self) -> float:
        reading = self._drive.read(self._condition.parameter, self._line.time)
        try:
            return float(reading.value)
        except ValueError:
            raise UsageError(
                f"parameter {self._condition.parameter} is no number but {reading.value!r}; "
                "choose another, or a model of the drive that knows its type"
            ) from None
