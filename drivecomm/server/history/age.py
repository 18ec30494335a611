"""The age limit of stored values. No I/O, no clock."""

from __future__ import annotations

CLOCK_TRUSTED_S = 3600.0


class AgeLimit:
    """An age limit in days, by a clock that may be wrong: values are dropped only after being too old for an hour.

    So a clock that is a year ahead deletes nothing if it is corrected within the hour.
    """

    def __init__(self, days: float) -> None:
        self._kept_s = days * 86400
        self._before_s = 0.0
        self._next: float | None = None
        self._since_s = 0.0

    def before_s(self, now_s: float, steady_s: float) -> float:
        """Return the time before which all values are too old.

        now_s: in seconds since 1970. steady_s: on a monotonic clock.
        """
        if self._next is None:
            self._next, self._since_s = now_s - self._kept_s, steady_s
        elif steady_s - self._since_s >= CLOCK_TRUSTED_S:
            self._before_s = min(self._next, now_s - self._kept_s)
            self._next, self._since_s = now_s - self._kept_s, steady_s
        return self._before_s
