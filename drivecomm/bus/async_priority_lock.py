"""A priority lock for tasks; see `drivecomm.bus.priority_lock`."""

from __future__ import annotations

import asyncio
from bisect import insort
from typing import TypeAlias

from drivecomm.bus.priority_lock import Rank

_Place: TypeAlias = tuple[Rank, int, "asyncio.Future[None]"]
"""A place in the queue: no two have the same number, so that they are in order by rank and then by coming."""


class AsyncPriorityLock:
    """A line among tasks. It is handed from one to the next, so that nobody slips in between."""

    def __init__(self) -> None:
        self._taken = False
        self._waiting: list[_Place] = []
        self._order = 0

    def stop_waits(self) -> bool:
        """Whether somebody waits who wants to stop something."""
        return bool(self._waiting) and self._waiting[0][0] is Rank.STOP

    async def take(self, rank: Rank, seconds: float) -> bool:
        """Wait for one's turn; returns False when it has not come within this time."""
        if not self._taken:
            self._taken = True
            return True
        self._order += 1
        called: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        place = (rank, self._order, called)
        insort(self._waiting, place)
        try:
            async with asyncio.timeout(None if seconds == float("inf") else seconds):
                await called
        except TimeoutError:
            return not self._left(place)
        except BaseException:
            if not self._left(place):
                self.give_back()
            raise
        return True

    def give_back(self) -> None:
        """End one's turn."""
        while self._waiting:
            _, _, called = self._waiting.pop(0)
            if not called.done():
                called.set_result(None)
                return
        self._taken = False

    def _left(self, place: _Place) -> bool:
        """Wait no more; returns False when it was one's turn already."""
        if place in self._waiting:
            self._waiting.remove(place)
            return True
        return place[2].cancelled()
