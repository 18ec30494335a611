"""Transit time of requests, measured by the client's own timestamps, even if its clock is wrong.

The clocks are not compared. The delay of a request is the difference to the fastest request on its connection. So a
request held up by a broken cable, possibly no longer wanted, is distinguished from one with a wrong clock.
"""

from __future__ import annotations

from datetime import datetime

_PERIOD_S = 60.0
_FIRST_YEAR = 1970


class Delay:
    """Delays on one connection. After two minutes, a clock that was set no longer counts as a delay."""

    def __init__(self) -> None:
        self._begun_s: float | None = None
        self._now = self._before = float("inf")

    def of(self, stamp: datetime | None, came_s: float) -> float:
        """Return how long a request was in transit, in seconds. stamp: time of the client, None if unknown.

        came_s: time of arrival, by `time.monotonic`.
        """
        if not isinstance(stamp, datetime) or stamp.year < _FIRST_YEAR:
            return 0.0
        offset = came_s - stamp.timestamp()
        if self._begun_s is None or came_s - self._begun_s > _PERIOD_S:
            self._begun_s, self._before, self._now = came_s, self._now, offset
        self._now = min(self._now, offset)
        return offset - min(self._now, self._before)
