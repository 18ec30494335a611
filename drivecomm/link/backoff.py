"""The pause between attempts at something that does not work: twice as long each time, up to a limit."""

from __future__ import annotations

from dataclasses import dataclass

REOPEN_FIRST_S = 0.5
REOPEN_LONGEST_S = 2.0
"""The pauses between attempts to open a port that was lost: the first, and the longest."""


@dataclass(slots=True)
class Backoff:
    """Doubles with each failure, from the first up to the longest; a success sets it back."""

    first_s: float
    longest_s: float
    over_at: float = float("-inf")
    """When the next attempt may be made."""
    _pause_s: float = 0.0

    def failed(self, now: float, least_s: float = 0.0) -> None:
        """Begin the next pause; it lasts at least so long, also where that is longer than the longest."""
        self._pause_s = min(2 * self._pause_s or self.first_s, self.longest_s)
        self.over_at = now + max(self._pause_s, least_s)

    def succeeded(self) -> None:
        """Have no pause any more."""
        self._pause_s = 0.0
        self.over_at = float("-inf")
