"""The latest values of one quantity, for a trend. No I/O, no clock."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Sequence

ROOM = 1200
"""How many samples a trend keeps: twenty minutes at one a second."""


class Sample(NamedTuple):
    """A value at a time; None where the drive was asked and gave none."""

    time_s: float
    value: float | None


class Trend:
    """A ring of samples. keeps_s: how long a value stands for what follows; after that there is a gap."""

    def __init__(self, *, keeps_s: float, room: int = ROOM) -> None:
        self._keeps_s = keeps_s
        self._samples: deque[Sample] = deque(maxlen=room)

    def add(self, time_s: float, value: float | None) -> None:
        """Take the next sample; times do not go back."""
        self._samples.append(Sample(time_s, value))

    @property
    def samples(self) -> Sequence[Sample]:
        """All samples that are kept, the oldest first."""
        return tuple(self._samples)

    def cells(self, number: int, *, until_s: float, each_s: float) -> list[float | None]:
        """Return what held at the end of each of so many stretches of time, the last of which ends at until_s.

        None before the first sample, after a failed one, and when the last sample is older than a value keeps.
        """
        times = [sample.time_s for sample in self._samples]
        return [self._at(times, until_s - each_s * back) for back in reversed(range(number))]

    def _at(self, times: list[float], time_s: float) -> float | None:
        # What is due at the end of a stretch may be a hair late.
        place = bisect_right(times, time_s + 1e-9)
        if not place or time_s - times[place - 1] > self._keeps_s:
            return None
        return self._samples[place - 1].value
