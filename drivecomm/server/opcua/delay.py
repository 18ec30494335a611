"""How long a request was on its way, by the client's own clock, whatever that clock says.

No clock is compared with another: what counts is how much later a request came than the quickest of its connection. So
one that a broken cable has held up, and that comes when nobody wants it any more, is told from a clock that is wrong.
"""

from __future__ import annotations

from datetime import datetime

_PERIOD_S = 60.0
_FIRST_YEAR = 1970


class Delay:
    """The delays of one connection. A clock that was set is taken for what it is after two minutes."""

    def __init__(self) -> None:
        self._begun_s: float | None = None
        self._now = self._before = float("inf")

    def of(self, stamp: datetime | None, came_s: float) -> float:
        """Return for how long a request was on its way. stamp: the client's, None for one that does not say.

        came_s: when it came, by `time.monotonic`.
        """
        if not isinstance(stamp, datetime) or stamp.year < _FIRST_YEAR:
            return 0.0
        offset = came_s - stamp.timestamp()
        if self._begun_s is None or came_s - self._begun_s > _PERIOD_S:
            self._begun_s, self._before, self._now = came_s, self._now, offset
        self._now = min(self._now, offset)
        return offset - min(self._now, self._before)
