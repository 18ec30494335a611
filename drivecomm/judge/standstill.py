"""Whether this machine had time for its programs: a verdict on timing from one that stood still is none."""

from __future__ import annotations

import time
from collections import deque
from threading import Event, Thread
from typing import Self

_STEP_S = 0.01
_MOST_KEPT = 2000
LONG_S = 0.1
"""A standstill that a master may take for a lost reply."""


class StandstillWatch:
    """Notes when no thread of this process was given the processor for a while, for the time of a block."""

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
        """Return the longest standstill since a time of `time.monotonic`; 0 for none that matters."""
        return max((lasted_s for ended, lasted_s in tuple(self._found) if ended >= since), default=0.0)

    def _watch(self) -> None:
        before = time.monotonic()
        while not self._ended.wait(_STEP_S):
            now = time.monotonic()
            if (late_s := now - before - _STEP_S) > LONG_S:
                self._found.append((now, late_s))
            before = now
