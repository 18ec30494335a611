"""Alarms and their transitions, as immutable values."""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import datetime
from typing import Literal, TypeAlias

Treated: TypeAlias = Literal["acknowledged", "confirmed", "commented"]
What: TypeAlias = Literal["raised", "reminded", "over"] | Treated


@dataclass(frozen=True, slots=True, kw_only=True)
class Alarm:
    """A standing alarm: its condition is present, or it is not acknowledged yet.

    id: never used again, not even after a restart. number: counts up. rule: the name of its `[[alarm]]`. text: its
    cause, which stays when the condition is gone. since_s: when its condition began, raised_s: when it was raised, both
    in seconds since 1970. gone: the finding that ended the condition, gone_s: its time; empty and None while the
    condition is present. times: number of times that the condition has appeared since the last acknowledgement.
    present: the condition is present, or was when last known. over_s: when the alarm was over, None before.
    acknowledged_by, acknowledged_s: the person who acknowledged it, and the time. told, told_s: the number of messages
    about it, and the time of the last one. which: the fault, if there can be several.
    """

    id: str
    number: int
    rule: str
    drive: str
    text: str
    since_s: float
    raised_s: float
    gone: str = ""
    gone_s: float | None = None
    times: int = 1
    present: bool = True
    known: bool = True
    over_s: float | None = None
    acknowledged_by: str = ""
    acknowledged_s: float | None = None
    confirmed_by: str = ""
    confirmed_s: float | None = None
    comment: str = ""
    comment_by: str = ""
    comment_s: float | None = None
    told: int = 0
    told_s: float = 0.0
    which: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class AlarmTransition:
    """A change of an alarm. alarm: its state right after the change, even if it is no longer standing."""

    what: What
    alarm: Alarm
    time_s: float

    @property
    def text(self) -> str:
        """The change in words: "pump tripped: fault F0400 overload"."""
        alarm = self.alarm
        often = f", {alarm.times} times" if alarm.times > 1 else ""
        said = f": {alarm.comment}" if alarm.comment_s == self.time_s and alarm.comment else ""
        if self.what == "acknowledged":
            return f"{alarm.rule}: acknowledged by {alarm.acknowledged_by} ({alarm.text}){said}"
        if self.what == "confirmed":
            return f"{alarm.rule}: confirmed by {alarm.confirmed_by} ({alarm.text}){said}"
        if self.what == "commented":
            return f"{alarm.rule}: comment of {alarm.comment_by} ({alarm.text}){said}"
        if self.what == "over":
            return f"{alarm.rule}: over: {alarm.text}{often}, {_span(alarm)}" + f"; now {alarm.gone}" * bool(alarm.gone)
        start = {"raised": "", "reminded": "still there: "}[self.what]
        return f"{alarm.rule}: {start}{alarm.text}{often}"


def _span(alarm: Alarm) -> str:
    """Return the beginning and the end of the condition as a text, in local time."""
    begin = datetime.fromtimestamp(alarm.since_s).astimezone()
    end = datetime.fromtimestamp(alarm.gone_s or alarm.over_s or alarm.since_s).astimezone()
    day = "" if end.date() == begin.date() else "%Y-%m-%d "
    return f"{begin:%Y-%m-%d %H:%M:%S} to {end:{day}%H:%M:%S %Z}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Treatment:
    """An action of a person on an alarm. by: their name. comment: empty without one."""

    what: Treated
    by: str
    time_s: float
    comment: str = ""

    def of(self, alarm: Alarm) -> AlarmTransition | None:
        """Return the transition of an alarm by this treatment, or None if it changes nothing.

        It changes nothing if the alarm was acknowledged or confirmed before, or cannot be confirmed yet.
        """
        if self.comment:
            alarm = replace(alarm, comment=self.comment, comment_by=self.by, comment_s=self.time_s)
        if self.what == "acknowledged":
            if alarm.acknowledged_by:
                return None
            alarm = replace(alarm, acknowledged_by=self.by, acknowledged_s=self.time_s)
        if self.what == "confirmed":
            if alarm.confirmed_by or not alarm.acknowledged_by:
                return None
            alarm = replace(alarm, confirmed_by=self.by, confirmed_s=self.time_s)
        return AlarmTransition(what=self.what, alarm=alarm, time_s=self.time_s)
