"""Deadlines by key, and the earliest of them."""

from __future__ import annotations

import heapq
from math import inf
from typing import Generic, TypeVar

Key = TypeVar("Key")


class Timers(Generic[Key]):
    """One movable deadline for each key; infinite for a key that is never due."""

    def __init__(self) -> None:
        self._deadlines: dict[Key, float] = {}
        # May hold outdated entries: an entry is valid while its key still has this deadline.
        self._heap: list[tuple[float, int, Key]] = []
        self._order = 0

    @property
    def deadline(self) -> float:
        """The earliest deadline; infinite if there is none."""
        heap = self._heap
        while heap and self._deadlines.get(heap[0][2], inf) != heap[0][0]:
            heapq.heappop(heap)
        return heap[0][0] if heap else inf

    def set(self, key: Key, deadline: float) -> None:
        """Set the deadline of a key, replacing any earlier one."""
        if self._deadlines.get(key, inf) == deadline:
            return
        self._deadlines[key] = deadline
        if deadline < inf:
            self._order += 1
            heapq.heappush(self._heap, (deadline, self._order, key))
            if len(self._heap) > 2 * len(self._deadlines) + _MOST_STALE:
                self._heap = [entry for entry in self._heap if self._deadlines[entry[2]] == entry[0]]
                heapq.heapify(self._heap)

    def pop(self, now: float) -> Key | None:
        """Return a key whose deadline has come, and clear its deadline; None if there is none."""
        if self.deadline > now:
            return None
        _, _, key = heapq.heappop(self._heap)
        self._deadlines[key] = inf
        return key


_MOST_STALE = 64
