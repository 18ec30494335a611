"""Rate limit for received messages: a flooded kind is not subscribed for a while. No I/O, no clock."""

from __future__ import annotations

from dataclasses import dataclass, field

from drivecomm.server import Bucket, Rate

A_SECOND = 50
"""Sustained messages per second of one kind, far more than operators cause."""
AT_ONCE = 100
EACH_DRIVE = 2
"""Further messages per second and drive: programs renew the lease of each drive, or stop all of them together."""
PAUSE_S = 10.0
"""Seconds without subscription after a flood; meanwhile the broker does not forward the messages."""


@dataclass(slots=True)
class RateLimit:
    """Rate of messages of one kind. refused: number of messages dropped since the last call of `taken`."""

    refused: int = 0
    _bucket: Bucket = field(default_factory=lambda: Bucket(AT_ONCE, 0.0))

    def admits(self, now: float, drives: int = 0) -> bool:
        """Whether one more message is allowed. now: monotonic seconds. drives: number of drives in the plant."""
        more = drives * EACH_DRIVE
        if self._bucket.wait_s(Rate(A_SECOND + more, AT_ONCE + more), now) > 0:
            self.refused += 1
            return False
        return True

    def taken(self) -> int:
        """Return the number of dropped messages and reset it."""
        refused, self.refused = self.refused, 0
        return refused
