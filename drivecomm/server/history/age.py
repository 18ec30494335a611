"""From when on values are too old to be kept. No I/O, no clock."""

from __future__ import annotations

CLOCK_TRUSTED_S = 3600.0


class AgeLimit:
    """So many days, by a clock that may be wrong: what is too old is given up only when it was so for an hour.

    So a clock that is a year ahead until somebody sets it costs no history.
    """

    def __init__(self, days: float) -> None:
        self._kept_s = days * 86400
        self._before_s = 0.0
        self._next: float | None = None
        self._since_s = 0.0

    def before_s(self, now_s: float, steady_s: float) -> float:
        """Return before when all is too old. now_s: in seconds since 1970. steady_s: by a clock that nobody sets."""
        if self._next is None:
            self._next, self._since_s = now_s - self._kept_s, steady_s
        elif steady_s - self._since_s >= CLOCK_TRUSTED_S:
            self._before_s = min(self._next, now_s - self._kept_s)
            self._next, self._since_s = now_s - self._kept_s, steady_s
        return self._before_s
