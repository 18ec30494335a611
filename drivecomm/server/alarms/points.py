"""One rule on one drive: its delays, its alarm, and the times of messages. No I/O, no clock.

Every call gets two times. now_s is monotonic and measures all durations. time_s is the time of day and is only
recorded, so setting the clock changes nothing but the times that people read.
"""

from __future__ import annotations

from dataclasses import replace
from math import inf
from typing import TYPE_CHECKING

from drivecomm.server.alarms.alarm import Alarm, AlarmTransition

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from drivecomm.server.alarms.alarm import Treatment, What
    from drivecomm.server.alarms.conditions import ConditionFinding
    from drivecomm.server.alarms.rules import AlarmRule

AGAIN_S = 60.0
"""An alarm whose acknowledgement has lapsed is sent again no sooner than this after its last message, in seconds."""


_NOW_UNKNOWN = "; now unknown: "


class RuleState:
    """A rule on a drive. alarm: the standing alarm, None without one.

    holds: whether the condition held when last known.
    """

    def __init__(self, rule: AlarmRule, drive: str) -> None:
        self.rule = rule
        self.drive = drive
        self.alarm: Alarm | None = None
        self.holds: bool | None = None
        self._text = self._cause = self._gone = ""
        self._which = ""
        self._since_s = 0.0
        # Seconds for which the current state of the condition was known up to _known_from, which is None while unknown.
        self._held_s = 0.0
        self._known_from: float | None = None
        self._went = False
        self._told_at = 0.0
        self._again = False

    @property
    def busy(self) -> bool:
        """Whether the state may change by the passing of time alone."""
        return bool(self.holds) or self.active

    @property
    def active(self) -> bool:
        """Whether there is an alarm that is not over."""
        return self.alarm is not None and self.alarm.over_s is None

    def restore(self, alarm: Alarm, now_s: float, time_s: float) -> None:
        """Restore an alarm that stood when the server ended; its condition counts as unchanged until known again."""
        self.alarm = alarm
        self._text, self._cause, self._gone = alarm.text, _known(alarm.text), alarm.gone
        self._since_s = alarm.since_s if alarm.gone_s is None else alarm.gone_s
        self._which = alarm.which
        if alarm.over_s is None:
            self.holds = alarm.present
            self._held_s = self.rule.for_s if alarm.present else 0.0
        # Even if the clock was set meanwhile, a reminder is neither lost nor due more than once.
        self._told_at = now_s - min(max(time_s - alarm.told_s, 0.0), self.rule.remind_s or AGAIN_S)

    def shown(self) -> Alarm | None:
        """Return the alarm in its current state, or None without one."""
        if self.alarm is None or not self.active:
            return self.alarm
        gone_s = self._since_s if self.holds is False else None
        return replace(
            self.alarm,
            text=self._text,
            gone="" if self.holds else self._gone,
            gone_s=gone_s,
            present=bool(self.holds),
            known=self._known_from is not None,
            which=self._which,
        )

    def see(self, finding: ConditionFinding, now_s: float, time_s: float) -> None:
        """Record the current condition; before that, `due` must be called for transitions that are due already."""
        if finding.holds is None:
            self._held_s = self._held(now_s)
            self._known_from = None
            if self.active:
                self._text = f"{_known(self._text)}{_NOW_UNKNOWN}{finding.text}"
            return
        if finding.holds is not self.holds:
            self._held_s = 0.0
            self._known_from = now_s
            self._since_s = time_s
            self._went = self._went or (self.active and not finding.holds)
        elif self._known_from is None:
            self._known_from = now_s
        self.holds = finding.holds
        if finding.holds:
            self._text = finding.text
            if not finding.lingers:
                self._cause = finding.text
        else:
            # The cause stays in the text; the end of the condition goes into `gone`.
            self._text, self._gone = self._cause, finding.text
        if self.active and finding.holds and finding.which:
            if self._which not in {"", finding.which}:
                self._lapse()
            self._which = finding.which
        elif not self.active:
            self._which = finding.which

    def due(self, now_s: float, time_s: float, number: Callable[[], tuple[int, str]]) -> Iterator[AlarmTransition]:
        """Yield the transitions that are due by now. number: returns the number and the id of a new alarm."""
        held = self._held(now_s)
        if self.holds and held >= self.rule.for_s:
            if not self.active:
                before = self.alarm.times if self.alarm else 0
                count, identity = number()
                self.alarm = Alarm(
                    id=identity, number=count, rule=self.rule.name, drive=self.drive, text=self._text,
                    since_s=self._since_s, raised_s=time_s, times=before + 1,
                )  # fmt: skip
                self._went = False
                yield self._tell("raised", now_s, time_s)
            elif self._went:
                self._came_back()
        if self.active and self.holds and now_s >= self._reminder_at():
            yield self._tell("reminded", now_s, time_s)
        if self.active and self.holds is False and held >= self.rule.over_s:
            told = self._tell("over", now_s, time_s)
            if told.alarm.acknowledged_by:
                self.alarm = None
            yield told

    def treat(self, treatment: Treatment) -> AlarmTransition | None:
        """Record the treatment of the alarm; return None if it changes nothing."""
        alarm = self.shown()
        done = None if alarm is None else treatment.of(alarm)
        if done is None:
            return None
        self.alarm = done.alarm if self.active or not done.alarm.acknowledged_by else None
        self._again = self._again and not done.alarm.acknowledged_by
        return done

    def _held(self, now_s: float) -> float:
        return self._held_s + (now_s - self._known_from if self._known_from is not None else 0.0)

    def _came_back(self) -> None:
        """Count a condition that came back before the alarm was over; an earlier acknowledgement lapses."""
        self._went = False
        if self.alarm is not None:
            self.alarm = replace(self.alarm, times=1 if self.alarm.acknowledged_by else self.alarm.times + 1)
            if self.alarm.acknowledged_by:
                self._lapse()

    def _lapse(self) -> None:
        if self.alarm is not None:
            self.alarm = replace(self.alarm, acknowledged_by="", acknowledged_s=None, confirmed_by="", confirmed_s=None)
            self._again = True

    def _reminder_at(self) -> float:
        if self.alarm is None or self.alarm.acknowledged_by:
            return inf
        each = self.rule.remind_s or inf
        return self._told_at + (min(each, AGAIN_S) if self._again else each)

    def _tell(self, what: What, now_s: float, time_s: float) -> AlarmTransition:
        shown = self.shown()
        assert shown is not None  # noqa: S101 - only called with an alarm
        over_s = time_s if what == "over" else None
        self.alarm = replace(shown, told=shown.told + 1, told_s=time_s, over_s=over_s)
        self._told_at = now_s
        self._again = False
        return AlarmTransition(what=what, alarm=self.alarm, time_s=time_s)


def _known(text: str) -> str:
    """Return the text of a cause without the appended reason why it is not known now."""
    return text.partition(_NOW_UNKNOWN)[0]
