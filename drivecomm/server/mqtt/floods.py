"""Too many messages at once: what comes too fast is not listened to for a while, told once. No I/O, no clock."""

from __future__ import annotations

from dataclasses import dataclass

A_SECOND = 50
"""So many messages of one kind may come each second, for as long as one likes: an operator presses few buttons."""
AT_ONCE = 100
EACH_DRIVE = 2
"""So many more for each drive of the plant: programs renew the lease of each, and stop all of them at once."""
PAUSE_S = 10.0
"""For so long nothing of the kind is listened to afterwards; the broker keeps the flood to itself."""


@dataclass(slots=True)
class Rate:
    """How fast messages of one kind come. refused: how many were thrown away since it was last asked for."""

    refused: int = 0
    _left: float = AT_ONCE
    _at: float = 0.0

    def admits(self, now: float, drives: int = 0) -> bool:
        """Whether one more may come now, on a clock that nobody sets. drives: how many the plant has."""
        more = drives * EACH_DRIVE
        self._left = min(float(AT_ONCE + more), self._left + (now - self._at) * (A_SECOND + more))
        self._at = now
        if self._left < 1.0:
            self.refused += 1
            return False
        self._left -= 1.0
        return True

    def taken(self) -> int:
        """Return how many were refused, and count anew."""
        refused, self.refused = self.refused, 0
        return refused
