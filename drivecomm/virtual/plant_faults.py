"""Faults of a plant's script: disturbed telegrams, and drives that trip on a condition."""

from __future__ import annotations

from random import Random
from typing import TYPE_CHECKING

from drivecomm.errors import DriveCommError, UsageError
from drivecomm.plant import disturbed
from drivecomm.protocol import fields_of
from drivecomm.virtual.plant_drive import PlantDrive

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivecomm.plant import TelegramFault, TripCondition
    from drivecomm.protocol import VirtualDrive
    from drivecomm.virtual.line import VirtualLine


class TelegramDisturbance:
    """Disturbance of the telegrams that a fault selects.

    met: number of selected telegrams. happened: number of disturbed ones. speed: seconds of the process per second of
    the line.
    """

    def __init__(self, fault: TelegramFault, speed: float) -> None:
        self.fault = fault
        self.met = 0
        self.happened = 0
        self._speed = speed
        self._random = Random(fault.seed)  # noqa: S311 - repeatable on purpose

    def __str__(self) -> str:
        fault = self.fault
        which = (
            f"every {fault.every}"
            if fault.every
            else ""
            if fault.rate is None
            else f"rate {fault.rate:g}, seed {fault.seed}"
        )
        sort = f"{fault.kind.value} of {fault.of or 'telegrams'}"
        return f"fault: {', '.join(filter(None, (sort, which)))}; happened: {self.happened} of {self.met}"

    def request(self, data: bytes, now: float) -> Sequence[tuple[float, bytes]]:
        """Return the parts of a request that arrive, as delays and bytes."""
        if self.fault.drive or self.fault.of not in (None, "request"):
            return [(0.0, data)]
        return self._disturbed(data, now)

    def reply(self, data: bytes, drive: VirtualDrive, now: float) -> Sequence[tuple[float, bytes]]:
        """Return the parts of a reply that arrive, as delays and bytes."""
        if not isinstance(drive, PlantDrive) or not self._means(drive):
            return [(0.0, data)]
        return self._disturbed(data, now)

    def _means(self, drive: PlantDrive) -> bool:
        fault = self.fault
        if fault.of == "request" or (fault.drive and fault.drive != drive.name):
            return False
        if fault.of not in (None, "reply", f"reply to a {drive.purpose}"):
            return False
        if not fault.to:
            return True
        asked = fields_of(drive.asked) if drive.asked is not None else {}
        return all(asked.get(name) == wanted for name, wanted in fault.to.items())

    def _disturbed(self, data: bytes, now: float) -> Sequence[tuple[float, bytes]]:
        fault = self.fault
        if not data or not fault.window.holds(now * self._speed):
            return [(0.0, data)]
        self.met += 1
        if fault.every is not None and self.met % fault.every:
            return [(0.0, data)]
        if fault.rate is not None and self._random.random() >= fault.rate:
            return [(0.0, data)]
        self.happened += 1
        return disturbed(fault.kind, data, self._random, delay_s=fault.delay_s)


PERIOD_S = 0.1
"""Interval for checking a condition, in seconds of the process."""

_SHORTEST_S = 0.01
"""Shortest interval for checking a condition, in seconds of the line, at any speed of the process."""


class ConditionWatch:
    """Watch that trips a drive when its parameter meets a condition while the drive has power.

    speed: seconds of the process per second of the line. Raises UsageError if the parameter does not hold a number.
    """

    def __init__(
        self, line: VirtualLine, drive: PlantDrive, condition: TripCondition, code: int, *, speed: float
    ) -> None:
        self._line = line
        self._drive = drive
        self._condition = condition
        self._code = code
        self._speed = speed
        self._period_s = max(PERIOD_S / speed, _SHORTEST_S)
        self._true_since: float | None = None
        self._has_tripped = False
        # A bad parameter must fail here, because the drive would record a refused read as an error.
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
                f"parameter {self._condition.parameter} is not a number but {reading.value!r}; "
                "choose another, or a model that knows its type"
            ) from None
