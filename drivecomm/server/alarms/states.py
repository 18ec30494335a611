"""All alarms of a plant: fed with changes and the time, they return their transitions. No I/O, no clock."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from drivecomm.errors import UsageError, shortened
from drivecomm.server.alarms.alarm import Alarm, AlarmTransition
from drivecomm.server.alarms.conditions import check_drive, check_value
from drivecomm.server.alarms.points import RuleState

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from drivecomm.server import CurrentValue, DriveSnapshot
    from drivecomm.server.alarms.alarm import Treatment
    from drivecomm.server.alarms.conditions import ConditionFinding
    from drivecomm.server.alarms.rules import AlarmRule


class Alarms:
    """The alarms of these rules, including alarms that stood before.

    run: a word that is unique to this run of the server. number: number of the last alarm before. now_s: seconds of a
    monotonic clock. time_s: seconds since 1970.
    """

    def __init__(
        self,
        rules: Iterable[AlarmRule],
        *,
        run: str,
        stood: Iterable[Alarm] = (),
        number: int = 0,
        now_s: float = 0.0,
        time_s: float = 0.0,
    ) -> None:
        self.number = number
        self._run = run
        self._of_drives: dict[str, list[RuleState]] = {}
        self._of_values: dict[tuple[str, str], list[RuleState]] = {}
        self._points: dict[tuple[str, str], RuleState] = {}
        for rule in rules:
            for drive in rule.drives:
                point = self._points[rule.name, drive] = RuleState(rule, drive)
                if rule.limit is None:
                    self._of_drives.setdefault(drive, []).append(point)
                else:
                    self._of_values.setdefault((drive, rule.limit.quantity), []).append(point)
        self._left: list[Alarm] = []
        for alarm in stood:
            if found := self._points.get((alarm.rule, alarm.drive)):
                found.restore(alarm, now_s, time_s)
            else:
                self._left.append(alarm)

    def watches(self, drive: str) -> bool:
        """Return whether a rule watches the state of this drive."""
        return drive in self._of_drives

    def drive_seen(self, state: DriveSnapshot, now_s: float, time_s: float) -> Sequence[AlarmTransition]:
        """Record a drive's state, and return the transitions."""
        found: list[AlarmTransition] = []
        for point in self._of_drives.get(state.name, ()):
            found += self._seen(point, check_drive(point.rule.on, state), now_s, time_s)
        return found

    def value_seen(self, value: CurrentValue, now_s: float, time_s: float) -> Sequence[AlarmTransition]:
        """Record a value, and return the transitions."""
        found: list[AlarmTransition] = []
        for point in self._of_values.get((value.drive, value.name), ()):
            if limit := point.rule.limit:
                found += self._seen(point, check_value(limit, value, before=bool(point.holds)), now_s, time_s)
        return found

    def look(self, now_s: float, time_s: float) -> Sequence[AlarmTransition]:
        """Return the transitions that are due by time alone."""
        found: list[AlarmTransition] = []
        for point in self._points.values():
            if point.busy:
                found += point.due(now_s, time_s, self._number)
        left, self._left = self._left, [alarm for alarm in self._left if alarm.over_s is not None]
        for alarm in left:
            if alarm.over_s is None:
                gone = "the plant file no longer has this alarm"
                over = replace(
                    alarm, gone=gone, gone_s=time_s, over_s=time_s, told=alarm.told + 1, told_s=time_s, present=False
                )
                if not over.acknowledged_by:
                    self._left.append(over)
                found.append(AlarmTransition(what="over", alarm=over, time_s=time_s))
        return found

    def standing(self) -> Sequence[Alarm]:
        """Return all alarms that are active or not acknowledged, in their order."""
        shown = (point.shown() for point in self._points.values())
        return sorted([*self._left, *(each for each in shown if each)], key=lambda alarm: alarm.number)

    def treat(self, alarm_id: str, treatment: Treatment) -> AlarmTransition | None:
        """Record the treatment of an alarm by a person; return None if it changes nothing.

        Raises UsageError for an alarm that does not stand.
        """
        for place, alarm in enumerate(self._left):
            if alarm.id == alarm_id:
                if (done := treatment.of(alarm)) is not None:
                    self._left[place : place + 1] = [] if done.alarm.acknowledged_by else [done.alarm]
                return done
        for point in self._points.values():
            if point.alarm is not None and point.alarm.id == alarm_id:
                return point.treat(treatment)
        raise UsageError(f"no alarm {shortened(alarm_id)} stands; it may be over, and acknowledged before")

    def _seen(self, point: RuleState, finding: ConditionFinding, now_s: float, time_s: float) -> list[AlarmTransition]:
        # Transitions that were due before the finding come first.
        found = list(point.due(now_s, time_s, self._number))
        point.see(finding, now_s, time_s)
        return [*found, *point.due(now_s, time_s, self._number)]

    def _number(self) -> tuple[int, str]:
        self.number += 1
        return self.number, f"{self._run}-{self.number}"
