"""What has happened on a line, counted: requests, replies, each kind of error, and how fast the drives answer."""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter
from dataclasses import dataclass, field

REPLY_TIME_BOUNDS_MS = (1, 2, 3, 5, 7, 10, 15, 20, 30, 50, 70, 100, 150, 200, 300, 500, 700, 1000)
"""Upper bounds of the histogram's classes; one more class holds what took longer."""


@dataclass(slots=True)
class ReplyTimes:
    """How long after a request's last character its reply was complete, in seconds, as a histogram."""

    classes: list[int] = field(default_factory=lambda: [0] * (len(REPLY_TIME_BOUNDS_MS) + 1))
    shortest_s: float = float("inf")
    longest_s: float = 0.0
    total_s: float = 0.0

    def add(self, seconds: float) -> None:
        """Count one reply."""
        self.classes[bisect_left(REPLY_TIME_BOUNDS_MS, seconds * 1000)] += 1
        self.total_s += seconds
        self.longest_s = max(self.longest_s, seconds)
        self.shortest_s = min(self.shortest_s, seconds)

    @property
    def count(self) -> int:
        """How many replies were counted."""
        return sum(self.classes)

    @property
    def mean_s(self) -> float:
        """The mean, 0 without any reply."""
        return self.total_s / self.count if self.count else 0.0


@dataclass(slots=True)
class Statistics:
    """What has happened with one drive.

    counters: requests, retries, replies, timeouts, damaged, strays, late replies, ..., each by name; what never
    happened is not there and counts 0. reply_times: how fast it answers.
    """

    counters: Counter[str] = field(default_factory=Counter)
    reply_times: ReplyTimes = field(default_factory=ReplyTimes)
