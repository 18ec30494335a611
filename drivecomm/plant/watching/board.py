"""Snapshot of a watcher, as immutable values. No I/O, no clock."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal, NamedTuple, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from drivecomm.line import ResultQuality
    from drivecomm.protocol import DriveConfig, DriveStatus, Reading

Reachability: TypeAlias = Literal["asking", "answers", "silent"]
"""Result of the last request. asking: no request has been completed yet.

answers: the drive replied, perhaps with a refusal. silent: the drive, or its line, did not answer.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class WatchedValue:
    """Latest value of one quantity. reading: last good one, None if there is no recent one. cause: why not."""

    name: str
    reading: Reading | None
    quality: ResultQuality
    cause: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveView:
    """State of a drive as last seen.

    status: the last status, None before the first one and since the drive fell silent. fault: present fault, empty
    without one. late: the line had no time to read the status, which may have changed since. last_status, last_fault:
    last known ones, kept while the drive is silent. error: why the last request failed, empty on success. age_s:
    seconds since the last answer, None before the first one. counters: by the names in
    `drivecomm.link.statistics.COUNTERS`. reply_s: mean reply time, 0 without replies.
    """

    drive: DriveConfig
    line: str
    reachability: Reachability = "asking"
    status: DriveStatus | None = None
    fault: str = ""
    late: bool = False
    last_status: DriveStatus | None = None
    last_fault: str = ""
    values: Mapping[str, WatchedValue] = field(default_factory=dict)
    error: str = ""
    age_s: float | None = None
    counters: Mapping[str, int] = field(default_factory=dict)
    reply_s: float = 0.0

    @property
    def name(self) -> str:
        """Name of the drive in the plant."""
        return self.drive.name

    def with_status(self, status: DriveStatus | None, fault: str) -> DriveView:
        """Return the view after a new status."""
        return replace(self, status=status, fault=fault, late=False, last_status=status, last_fault=fault)

    def silent(self, error: str) -> DriveView:
        """Return the view after the drive, or its line, did not answer."""
        return replace(self, reachability="silent", status=None, fault="", late=False, error=error)


@dataclass(frozen=True, slots=True, kw_only=True)
class Board:
    """All drives at one moment.

    elapsed_s: seconds since watching began. events: changes, the latest first. began_s: when watching began, in seconds
    since 1970; None on virtual lines, which have no time of day.
    """

    drives: tuple[DriveView, ...]
    events: tuple[DriveEvent, ...] = ()
    elapsed_s: float = 0.0
    began_s: float | None = None

    @property
    def faults(self) -> int:
        """Number of drives with a fault."""
        return sum(bool(view.fault) for view in self.drives)

    @property
    def silent(self) -> int:
        """Number of drives that do not answer."""
        return sum(view.reachability == "silent" for view in self.drives)

    def view(self, name: str) -> DriveView:
        """Return one drive by its name. Raises KeyError."""
        for view in self.drives:
            if view.name == name:
                return view
        raise KeyError(name)


Kind: TypeAlias = Literal["fault", "silent", "warning", "change", "command"]


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveEvent:
    """Event that a person may want to review. time_s: seconds since watching began."""

    time_s: float
    drive: str
    kind: Kind
    text: str


def changes(before: DriveView, after: DriveView, time_s: float) -> list[DriveEvent]:
    """Return the events between two views of a drive, even if it was silent in between."""
    found: list[tuple[Kind, str]] = []
    if after.reachability == "silent" != before.reachability:
        found.append(("silent", after.error or "does not answer"))
    if after.reachability == "answers" and before.reachability == "silent":
        found.append(("change", "answers again"))
    if after.reachability == "answers":
        found += _by_status(before, after)
    return [DriveEvent(time_s=time_s, drive=after.name, kind=kind, text=text) for kind, text in found]


def _by_status(before: DriveView, after: DriveView) -> list[tuple[Kind, str]]:
    if after.status is None:
        return []
    if after.fault:
        return [("fault", f"fault: {after.fault}")] if after.fault != before.last_fault else []
    found: list[tuple[Kind, str]] = []
    last = before.last_status
    if before.last_fault:
        found.append(("change", "the fault is gone"))
    if after.status.warning and not (last and last.warning):
        found.append(("warning", "warning"))
    if last is not None and state_words(after.status) != state_words(last):
        found.append(("change", state_words(after.status)))
    return found


def state_words(status: DriveStatus) -> str:
    """Return the state of a drive in words: running, running backwards, ready, not ready, stopping, fault."""
    words = status.state.value.replace("_", " ")
    return f"{words} backwards" if status.running and status.reverse else words


ROOM = 1200
"""Number of samples that a trend holds: twenty minutes at one per second."""


class TrendSample(NamedTuple):
    """Value at a time; None if the read failed."""

    time_s: float
    value: float | None


class Trend:
    """Ring buffer of samples. keeps_s: seconds after which a sample expires and a gap begins."""

    def __init__(self, *, keeps_s: float, room: int = ROOM) -> None:
        self._keeps_s = keeps_s
        self._samples: deque[TrendSample] = deque(maxlen=room)

    def add(self, time_s: float, value: float | None) -> None:
        """Add the next sample; times must not decrease."""
        self._samples.append(TrendSample(time_s, value))

    @property
    def samples(self) -> Sequence[TrendSample]:
        """All stored samples, the oldest first."""
        return tuple(self._samples)

    def cells(self, number: int, *, until_s: float, each_s: float) -> list[float | None]:
        """Return the value at the end of each of N equal time spans, the last of which ends at until_s.

        None before the first sample, after a failed one, and if the last sample has expired.
        """
        times = [sample.time_s for sample in self._samples]
        return [self._at(times, until_s - each_s * back) for back in reversed(range(number))]

    def _at(self, times: list[float], time_s: float) -> float | None:
        # A sample that is due at the end of a span may be marginally late.
        place = bisect_right(times, time_s + 1e-9)
        if not place or time_s - times[place - 1] > self._keeps_s:
            return None
        return self._samples[place - 1].value
