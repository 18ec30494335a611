"""Delivery of a poll plan's results from several lines to one reader; the lines wait for a slow reader."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

from drivecomm.line.poll_items import PollResult

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

MOST_WAITING = 1000
"""Queue limit of a slow reader, in results; the lines then read nothing until it has taken some."""

NAP_S = 0.1
"""Poll interval in seconds of a line that waits for a slow reader, and of the check for a cancelled plan."""


class ResultDelivery:
    """Queue of results from several lines, each in its own thread or task, for one reader.

    ring: wakes the reader; called in the thread or task of a line.
    """

    def __init__(self, ring: Callable[[], object]) -> None:
        self.ring = ring
        self.waiting: deque[PollResult | BaseException | None] = deque()
        """Results and ends of lines for the reader; `ring` must be called after additions."""
        self.left = 0
        """Number of lines that have not ended."""
        self.stopped = False
        """Whether the plan was cancelled; the lines then begin nothing more."""

    def give(self, result: PollResult) -> None:
        """Add a result and wake the reader."""
        self.waiting.append(result)
        self.ring()

    def end(self, error: BaseException | None = None) -> None:
        """Report that one line has ended. error: raised in the reader."""
        self.waiting.append(error)
        self.ring()

    def nap_s(self) -> float:
        """Return the seconds that a line must wait for a slow reader before its next check; 0 if it may continue."""
        return NAP_S if len(self.waiting) >= MOST_WAITING and not self.stopped else 0.0

    def read(self) -> Iterator[PollResult]:
        """Yield the results that are there now. Raises the error with which a line has ended."""
        while self.waiting:
            each = self.waiting.popleft()
            if isinstance(each, PollResult):
                yield each
            elif each is None:
                self.left -= 1
            else:
                raise each
