"""An alarm, and what happens to it, as values that do not change."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

What: TypeAlias = Literal["raised", "reminded", "acknowledged", "over"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Alarm:
    """An alarm that stands: its condition is there, or nobody has acknowledged it yet.

    id: not used again, also not after a restart. number: counts up. rule: the name of its `[[alarm]]`. text: what is
    the matter now. since_s: when its condition began, raised_s: when it was raised, both in seconds since 1970. times:
    how often the condition was there since somebody last acknowledged the alarm. present: the condition is there, or
    was when it was last known. over_s: when the alarm was over, None before. acknowledged_by, acknowledged_s: who has
    acknowledged it, and when. told, told_s: how many messages were made of it, and when the last one. which: the
    fault, where there can be several.
    """

    id: str
    number: int
    rule: str
    drive: str
    text: str
    since_s: float
    raised_s: float
    times: int = 1
    present: bool = True
    over_s: float | None = None
    acknowledged_by: str = ""
    acknowledged_s: float | None = None
    told: int = 0
    told_s: float = 0.0
    which: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Transition:
    """Something that happened to an alarm. alarm: as it was right afterwards, also when it stands no longer."""

    what: What
    alarm: Alarm
    time_s: float

    @property
    def text(self) -> str:
        """What happened, for people: "pump tripped: fault F0400 overload"."""
        alarm = self.alarm
        often = f", {alarm.times} times" if alarm.times > 1 else ""
        if self.what == "acknowledged":
            return f"{alarm.rule}: acknowledged by {alarm.acknowledged_by}"
        start = {"raised": "", "reminded": "still there: ", "over": "over: "}[self.what]
        return f"{alarm.rule}: {start}{alarm.text}{often}"
