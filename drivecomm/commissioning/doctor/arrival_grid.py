"""Whether replies come whenever they are ready, or only at the ticks of an adapter's latency timer."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

_LEAST_INTERVALS = 7
_OFF_GRID_S = 0.0008


def arrival_grid_s(arrivals_s: Sequence[float], steps_s: Sequence[float] = (0.016, 0.008)) -> float | None:
    """Return the step of time on which replies come that were asked for at uneven times; None where there is none.

    A USB adapter with a latency timer hands over what it received at the timer's ticks only.
    """
    intervals = [later - earlier for earlier, later in pairwise(arrivals_s)]
    if len(intervals) < _LEAST_INTERVALS:
        return None
    for step in steps_s:
        off = sum(abs(interval - round(interval / step) * step) > _OFF_GRID_S for interval in intervals)
        if off <= len(intervals) // 10:
            return step
    return None
