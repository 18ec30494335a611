"""Rate limits for requests that take time on a line: token buckets of callers and lines. No I/O, no clock."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from threading import Lock

_MOST_BUCKETS = 10_000


@dataclass(frozen=True, slots=True)
class Rate:
    """A rate limit: per_s in the long run, and up to `burst` requests together after a pause."""

    per_s: float
    burst: float


READ_RATE = Rate(10.0, 50.0)
"""Default rate for values that a caller reads from one line: about half of what a line at 9600 baud carries."""


@dataclass(slots=True)
class Bucket:
    """A token bucket. at_s: the time of the last update, on a monotonic clock."""

    left: float
    at_s: float

    def wait_s(self, rate: Rate, now_s: float, cost: float = 1.0) -> float:
        """Return 0 and take tokens if the request is allowed now; otherwise return the seconds until it is.

        A request may cost more tokens than are left, and even more than the bucket holds: later requests then wait
        longer.
        """
        self.left = min(rate.burst, self.left + max(0.0, now_s - self.at_s) * rate.per_s)
        self.at_s = now_s
        if self.left < 1.0:
            return (1.0 - self.left) / rate.per_s
        self.left -= cost
        return 0.0


class Rates:
    """The buckets of all callers, by key; may be used from any thread."""

    def __init__(self, rate: Rate) -> None:
        self._rate = rate
        self._lock = Lock()
        self._buckets: OrderedDict[tuple[str, ...], Bucket] = OrderedDict()

    def wait_s(self, of: tuple[str, ...], now_s: float, cost: float = 1.0) -> float:
        """Return 0 and take tokens if the request is allowed now; otherwise return the seconds until it is."""
        with self._lock:
            bucket = self._buckets.setdefault(of, Bucket(self._rate.burst, now_s))
            self._buckets.move_to_end(of)
            while len(self._buckets) > _MOST_BUCKETS:
                self._buckets.popitem(last=False)
            return bucket.wait_s(self._rate, now_s, cost)
