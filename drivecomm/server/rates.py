"""How fast a caller may ask for what takes time on a line: token buckets of callers and lines. No I/O, no clock."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from threading import Lock

_MOST_BUCKETS = 10_000


@dataclass(frozen=True, slots=True)
class Rate:
    """A rate: per_s for as long as one likes, and burst at once after a pause."""

    per_s: float
    burst: float


READ_RATE = Rate(10.0, 50.0)
"""Values that a caller may read from each line: about half of what a line of 9600 baud carries."""


@dataclass(slots=True)
class Bucket:
    """A full bucket of tokens, at a time of a clock that nobody sets."""

    left: float
    at_s: float

    def wait_s(self, rate: Rate, now_s: float, cost: float = 1.0) -> float:
        """Return 0 if something may be done now, and count it; otherwise in how many seconds it may be.

        One thing may cost more than there is left, and even than the bucket holds: those after it wait for longer.
        """
        self.left = min(rate.burst, self.left + max(0.0, now_s - self.at_s) * rate.per_s)
        self.at_s = now_s
        if self.left < 1.0:
            return (1.0 - self.left) / rate.per_s
        self.left -= cost
        return 0.0


class Rates:
    """The buckets of all callers, by what tells them apart; may be used from any thread."""

    def __init__(self, rate: Rate) -> None:
        self._rate = rate
        self._lock = Lock()
        self._buckets: OrderedDict[tuple[str, ...], Bucket] = OrderedDict()

    def wait_s(self, of: tuple[str, ...], now_s: float, cost: float = 1.0) -> float:
        """Return 0 if something may be done now, and count it; otherwise in how many seconds it may be."""
        with self._lock:
            bucket = self._buckets.setdefault(of, Bucket(self._rate.burst, now_s))
            self._buckets.move_to_end(of)
            while len(self._buckets) > _MOST_BUCKETS:
                self._buckets.popitem(last=False)
            return bucket.wait_s(self._rate, now_s, cost)
