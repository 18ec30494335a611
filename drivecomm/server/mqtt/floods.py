"""Messages that come faster than anybody means them, so that nothing is listened to for a while. No I/O, no clock."""

from __future__ import annotations

from dataclasses import dataclass, field

from drivecomm.server import Bucket, Rate

A_SECOND = 50
"""So many messages of one kind may come each second, for as long as one likes: an operator presses few buttons."""
AT_ONCE = 100
EACH_DRIVE = 2
"""So many more for each drive of the plant: programs renew the lease of each, and stop all of them at once."""
PAUSE_S = 10.0
"""For so long nothing of the kind is listened to afterwards; the broker keeps the flood to itself."""


@dataclass(slots=True)
class Flood:
    """How fast messages of one kind come. refused: how many were thrown away since it was last asked for."""

    refused: int = 0
    _bucket: Bucket = field(default_factory=lambda: Bucket(AT_ONCE, 0.0))

    def admits(self, now: float, drives: int = 0) -> bool:
        """Whether one more may come now, on a clock that nobody sets. drives: how many the plant has."""
        more = drives * EACH_DRIVE
        if self._bucket.wait_s(Rate(A_SECOND + more, AT_ONCE + more), now) > 0:
            self.refused += 1
            return False
        return True

    def taken(self) -> int:
        """Return how many were refused, and count anew."""
        refused, self.refused = self.refused, 0
        return refused
