"""Results of a poll plan on their way from its lines to the one who reads them; the lines wait for a slow reader."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

from drivecomm.line.poll_items import PollResult

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

MOST_WAITING = 1000
"""So many results wait for a slow reader; then the lines ask for nothing until it has taken some."""

NAP_S = 0.1
"""How often a line that waits looks whether it may go on; a plan that is given up ends within this time, too."""


class Delivery:
    """What lines hand over, each in a thread or task of its own, to one reader.

    ring: wakes the reader; called in the thread or task of a line.
    """

    def __init__(self, ring: Callable[[], object]) -> None:
        self.ring = ring
        self.waiting: deque[PollResult | BaseException | None] = deque()
        """What waits for the reader; who adds to it rings, at once or after more of it."""
        self.left = 0
        """How many still deliver."""
        self.stopped = False
        """Whether the plan was given up; the lines then begin nothing any more."""

    def give(self, result: PollResult) -> None:
        """Hand over a result."""
        self.waiting.append(result)
        self.ring()

    def end(self, error: BaseException | None = None) -> None:
        """Take note that one that delivers is at its end. error: raised where the results are read."""
        self.waiting.append(error)
        self.ring()

    def nap_s(self) -> float:
        """Return how long a line naps before it looks again, because the reader is slow; 0 if it may go on."""
        return NAP_S if len(self.waiting) >= MOST_WAITING and not self.stopped else 0.0

    def read(self) -> Iterator[PollResult]:
        """Yield what has come so far. Raises what one of those that deliver has failed with."""
        while self.waiting:
            each = self.waiting.popleft()
            if isinstance(each, PollResult):
                yield each
            elif each is None:
                self.left -= 1
            else:
                raise each
