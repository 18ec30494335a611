"""Statistics of a line: counters of requests, replies and each kind of error, and the reply times of the drives."""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

REPLY_TIME_BOUNDS_MS = (1, 2, 3, 5, 7, 10, 15, 20, 30, 50, 70, 100, 150, 200, 300, 500, 700, 1000)
"""Upper bounds of the histogram's classes in milliseconds; one more class holds longer times."""

COUNTERS = {
    "requests": "requests sent; a repetition counts as a retry",
    "replies": "good replies",
    "retries": "repeated requests",
    "timeouts": "requests and repetitions without a reply in time",
    "damaged": "requests and repetitions whose reply was damaged",
    "framing errors": "telegrams in which a fixed character was wrong",
    "length errors": "telegrams in which the length was wrong",
    "checksum errors": "telegrams in which the check was wrong",
    "field errors": "telegrams in which a field held an invalid value",
    "doubtful": "requests repeated because a reply may have been to another master, or to an earlier request",
    "overtaken": "requests whose replies were not awaited, because a stop went first",
    "strays": "sound telegrams that did not answer the request: late, repeated, or for another master",
    "echoes": "rejected telegrams: requests that came back, or what stood in place of an expected echo",
    "echo bytes": "own bytes that were echoed",
    "echoes missing": "replies before which the echo that was expected did not come whole",
    "noise bytes": "bytes within a reply time that belonged to no telegram",
    "unasked bytes": "bytes that arrived before a request was sent",
    "drained bytes": "bytes discarded after an error, until the line was quiet",
    "tunings given up": "times that errors rose and tuned turnarounds were given up for the whole line",
    "probes": "probes of drives that had been given up",
}
"""Descriptions of the counters, by name."""


@dataclass(slots=True)
class ReplyTimes:
    """Histogram of reply times in seconds, from a request's last character to the complete reply."""

    classes: list[int] = field(default_factory=lambda: [0] * (len(REPLY_TIME_BOUNDS_MS) + 1))
    shortest_s: float = float("inf")
    longest_s: float = 0.0
    total_s: float = 0.0

    def add(self, seconds: float) -> None:
        """Count one reply."""
        self.classes[bisect_left(REPLY_TIME_BOUNDS_MS, seconds * 1000)] += 1
        self.total_s += seconds
        if not self.shortest_s <= seconds <= self.longest_s:
            self.longest_s = max(self.longest_s, seconds)
            self.shortest_s = min(self.shortest_s, seconds)

    @property
    def count(self) -> int:
        """Number of counted replies."""
        return sum(self.classes)

    @property
    def mean_s(self) -> float:
        """Mean reply time in seconds; 0 without any reply."""
        return self.total_s / self.count if self.count else 0.0

    def percentile_s(self, percent: float) -> float:
        """Return the time in seconds within which `percent` (0 to 100) of the replies came; 0 without any reply.

        The time is interpolated linearly between the bounds of its class, so it is only as exact as this class.
        """
        place = self.count * min(100.0, max(0.0, percent)) / 100
        below = 0
        for number, held in enumerate(self.classes):
            if held and below + held >= place:
                lower, upper = self._bounds_s(number)
                return lower + (upper - lower) * (place - below) / held
            below += held
        return 0.0

    def _bounds_s(self, number: int) -> tuple[float, float]:
        """Return the limits of a class in seconds: its bounds, narrowed to the shortest and the longest reply time."""
        lower = REPLY_TIME_BOUNDS_MS[number - 1] / 1000 if number else 0.0
        upper = REPLY_TIME_BOUNDS_MS[number] / 1000 if number < len(REPLY_TIME_BOUNDS_MS) else self.longest_s
        return max(lower, self.shortest_s), min(upper, self.longest_s)


@dataclass(slots=True)
class Statistics:
    """Statistics of one drive.

    counters: number of events of each kind in COUNTERS; a kind that never occurred is absent and counts 0. reply_times:
    histogram of its reply times.
    """

    counters: Counter[str] = field(default_factory=Counter)
    reply_times: ReplyTimes = field(default_factory=ReplyTimes)


def total(each: Iterable[Statistics]) -> Statistics:
    """Return the combined statistics of several drives, such as `total(bus.statistics.values())` for a bus."""
    result = Statistics()
    times = result.reply_times
    for one in each:
        result.counters.update(one.counters)
        times.classes = [ours + theirs for ours, theirs in zip(times.classes, one.reply_times.classes, strict=True)]
        times.shortest_s = min(times.shortest_s, one.reply_times.shortest_s)
        times.longest_s = max(times.longest_s, one.reply_times.longest_s)
        times.total_s += one.reply_times.total_s
    return result
