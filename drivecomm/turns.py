"""Whose turn it is on a line: one at a time, the more urgent first, otherwise in the order of coming."""

from __future__ import annotations

import heapq
from enum import IntEnum
from threading import Lock
from typing import Generic, TypeVar

W = TypeVar("W")


class Rank(IntEnum):
    """How urgent a call is: stopping overtakes commands and writes, they overtake readings, and all overtake polls."""

    STOP = 0
    COMMAND = 1
    READ = 2
    POLL = 3


class Queue(Generic[W]):
    """Who waits for the line, in the order in which they get it."""

    def __init__(self) -> None:
        self._waiting: list[tuple[Rank, int, W]] = []
        self._order = 0

    def __len__(self) -> int:
        return len(self._waiting)

    def join(self, rank: Rank, who: W) -> None:
        """Begin to wait."""
        self._order += 1
        heapq.heappush(self._waiting, (rank, self._order, who))

    def next(self) -> W:
        """Take the first out."""
        return heapq.heappop(self._waiting)[2]

    def leave(self, who: W) -> bool:
        """Wait no more; returns False for one who does not wait, because it is their turn already."""
        for place, (_, _, waiting) in enumerate(self._waiting):
            if waiting is who:
                self._waiting[place] = self._waiting[-1]
                self._waiting.pop()
                heapq.heapify(self._waiting)
                return True
        return False


class Turns:
    """Turns of threads. The line is handed from one to the next, so that nobody slips in between."""

    def __init__(self) -> None:
        self._guard = Lock()
        self._taken = False
        self._queue: Queue[Lock] = Queue()

    def take(self, rank: Rank, seconds: float) -> bool:
        """Wait for one's turn; returns False when it has not come within this time."""
        with self._guard:
            if not self._taken:
                self._taken = True
                return True
            called = Lock()
            called.acquire()
            self._queue.join(rank, called)
        try:
            if called.acquire(timeout=max(0.0, min(seconds, _LONGEST_S))):
                return True
        except BaseException:
            # Interrupted: whoever was called in this moment hands the line on.
            if not self._left(called):
                self.give_back()
            raise
        return not self._left(called)

    def give_back(self) -> None:
        """End one's turn."""
        with self._guard:
            if self._queue:
                self._queue.next().release()
            else:
                self._taken = False

    def _left(self, called: Lock) -> bool:
        with self._guard:
            return self._queue.leave(called)


_LONGEST_S = 1e6
