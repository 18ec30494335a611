"""Summaries of a numeric quantity over periods: mean, extremes, count. No I/O, no clock.

The number is interpolated linearly between values, and stays constant after the last one. Gaps are interpolated too,
and marked in the summary.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass
from decimal import Decimal
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from drivecomm.server.history.thinning import CoursePoint


@dataclass(slots=True)
class PeriodSummary:
    """The summary of one period, in seconds since 1970 and in the unit of the number.

    number, total, lowest, highest: count, sum, minimum and maximum of the values that were read in it; a value at its
    end belongs to the next period. at_begin: the number at the beginning, None before the first value. area, known_s:
    the integral over the time in which the number is known, and the length of that time. has_gap: values were missing.
    is_held: the number was held constant after the last value.
    """

    begin_s: float
    end_s: float
    number: int = 0
    total: float = 0.0
    lowest: float | None = None
    highest: float | None = None
    at_begin: float | None = None
    area: float = 0.0
    known_s: float = 0.0
    has_gap: bool = False
    is_held: bool = False

    def add(self, value: float) -> None:
        """Add a value that was read in this period."""
        self.number += 1
        self.total += value
        self.lowest = value if self.lowest is None else min(self.lowest, value)
        self.highest = value if self.highest is None else max(self.highest, value)

    @property
    def mean(self) -> float | None:
        """The mean of the values that were read; None without any."""
        return self.total / self.number if self.number else None

    @property
    def mean_over_time(self) -> float | None:
        """The mean over the time in which the number is known; None if it never is."""
        return self.area / self.known_s if self.known_s else None


class _Known(NamedTuple):
    time_s: float
    value: float


def summarized(points: Iterable[CoursePoint], stretches: Sequence[tuple[float, float]]) -> list[PeriodSummary]:
    """Return the summaries of a number over consecutive periods.

    points: in the order of time, including the last one before the first period and the first one after the last
    period, if there are any. A value that is not a number counts as missing.
    """
    course = _Course([PeriodSummary(begin_s, end_s) for begin_s, end_s in stretches])
    last: _Known | None = None
    missing_s: float | None = None
    for point in points:
        if last is not None and point.time_s < last.time_s:
            # Points from before the clock was set back are skipped.
            continue
        if not isinstance(point.value, int | float | Decimal):
            missing_s = point.time_s if missing_s is None else missing_s
            continue
        now = _Known(point.time_s, float(point.value))
        if missing_s is not None:
            course.miss(missing_s, now.time_s)
            missing_s = None
        if last is not None:
            course.go_on(last, now)
        course.read(now)
        last = now
    if missing_s is not None:
        course.miss(missing_s, math.inf)
    if last is not None:
        course.hold(last)
    return course.found


class _Course:
    """Builder of the summaries from the curve of a number."""

    def __init__(self, found: list[PeriodSummary]) -> None:
        self.found = found
        self._begins = [each.begin_s for each in found]

    def read(self, now: _Known) -> None:
        """Add a value that was read."""
        for each in self._between(now.time_s, now.time_s):
            each.add(now.value)

    def go_on(self, last: _Known, now: _Known) -> None:
        """Add the straight line from one value to the next."""
        if last.time_s == now.time_s:
            return
        slope = (now.value - last.value) / (now.time_s - last.time_s)
        for each in self._between(last.time_s, now.time_s):
            begin_s, end_s = max(last.time_s, each.begin_s), min(now.time_s, each.end_s)
            middle = last.value + slope * ((begin_s + end_s) / 2 - last.time_s)
            each.area += middle * (end_s - begin_s)
            each.known_s += end_s - begin_s
            if last.time_s <= each.begin_s < now.time_s:
                each.at_begin = last.value + slope * (each.begin_s - last.time_s)

    def hold(self, last: _Known) -> None:
        """Add the constant line after the last value."""
        for each in self._between(last.time_s, math.inf):
            known_s = each.end_s - max(last.time_s, each.begin_s)
            each.area += last.value * known_s
            each.known_s += known_s
            each.is_held = True
            if last.time_s <= each.begin_s:
                each.at_begin = last.value

    def miss(self, from_s: float, to_s: float) -> None:
        """Mark the summaries of a time in which values are missing."""
        for each in self._between(from_s, to_s):
            each.has_gap = True

    def _between(self, from_s: float, to_s: float) -> Iterator[PeriodSummary]:
        """Yield the periods that overlap a time; for a single moment, the period that contains it."""
        place = max(0, bisect_right(self._begins, from_s) - 1)
        while place < len(self.found) and (self._begins[place] < to_s or self._begins[place] <= from_s):
            if from_s < self.found[place].end_s:
                yield self.found[place]
            place += 1
