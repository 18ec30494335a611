"""Turns of tasks on a line; see `drivecomm.bus.turns`."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

from drivecomm.bus.turns import Queue

if TYPE_CHECKING:
    from drivecomm.bus.turns import Rank


class AsyncTurns:
    """Turns of tasks. The line is handed from one to the next, so that nobody slips in between."""

    def __init__(self) -> None:
        self._taken = False
        self._queue: Queue[asyncio.Future[None]] = Queue()

    def stop_waits(self) -> bool:
        """Whether somebody waits who wants to stop something."""
        return self._queue.stop_waits

    async def take(self, rank: Rank, seconds: float) -> bool:
        """Wait for one's turn; returns False when it has not come within this time."""
        if not self._taken:
            self._taken = True
            return True
        called: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._queue.join(rank, called)
        try:
            async with asyncio.timeout(None if seconds == float("inf") else seconds):
                await called
        except TimeoutError:
            return not self._left(called)
        except BaseException:
            if not self._left(called):
                self.give_back()
            raise
        return True

    def give_back(self) -> None:
        """End one's turn."""
        while self._queue:
            called = self._queue.next()
            if not called.done():
                called.set_result(None)
                return
        self._taken = False

    def _left(self, called: asyncio.Future[None]) -> bool:
        """Wait no more; returns False when it was one's turn already."""
        return self._queue.leave(called) or called.cancelled()
