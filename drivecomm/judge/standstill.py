"""Detection of standstills of this machine, which make a verdict on timing worthless."""

from __future__ import annotations

import time
from collections import deque
from threading import Event, Thread
from typing import Self

_STEP_S = 0.01
_MOST_KEPT = 2000
LONG_S = 0.1
"""Standstill in seconds that a master may take for a lost reply."""


class StandstillWatch:
    """Watch for moments in which this process got no processor time, for the duration of a block."""

    def __init__(self) -> None:
        self._found: deque[tuple[float, float]] = deque(maxlen=_MOST_KEPT)
        self._ended = Event()
        self._thread = Thread(target=self._watch, name="drivecomm judge standstill", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()

    def longest_s(self, since: float) -> float:
        """Return the longest standstill since a time of `time.monotonic`; 0 if none is relevant."""
        return max((lasted_s for ended, lasted_s in tuple(self._found) if ended >= since), default=0.0)

    def _watch(self) -> None:
        before = time.monotonic()
        while not self._ended.wait(_STEP_S):
            now = time.monotonic()
            if (late_s := now - before - _STEP_S) > LONG_S:
                self._found.append((now, late_s))
            before = now
