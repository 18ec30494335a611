"""Turns on a line for the tasks of one event loop."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

from drivecomm.line.queue import LineQueue, Place, Rank

if TYPE_CHECKING:
    from collections.abc import Callable


class TaskTurn(Place):
    """The turn of one call of the running task. on_stop: called while it has the line and a stop waits."""

    __slots__ = ("_called", "_on_stop", "is_over")

    def __init__(self, rank: Rank, on_stop: Callable[[], None], *, behind: bool = False) -> None:
        super().__init__(rank, asyncio.current_task(), behind=behind)
        self.is_over = False
        self._called: asyncio.Future[None] | None = None
        self._on_stop = on_stop

    def is_alive(self) -> bool:
        """Return whether the turn is not over, and its task not cancelled while it waits."""
        return not self.is_over and (self._called is None or not self._called.cancelled())

    def begin_waiting(self) -> None:
        """Make the future that the task awaits."""
        self._called = asyncio.get_running_loop().create_future()

    def wake(self) -> None:
        """Have the task continue."""
        if self._called is not None and not self._called.done():
            self._called.set_result(None)

    def give_way(self) -> None:
        """Have the runner look at once."""
        self._on_stop()

    async def come(self) -> None:
        """Wait to be woken."""
        if self._called is not None:
            await self._called


class TaskTurns:
    """Hands one line from task to task."""

    def __init__(self) -> None:
        self.queue = LineQueue()
        self.stop_waits = self.queue.stop_waits

    async def take(self, turn: TaskTurn, seconds: float) -> bool:
        """Wait for a turn; returns False if it has not come within this time. Raises as `LineQueue.ask`."""
        if self.queue.ask(turn):
            return True
        try:
            async with asyncio.timeout(None if seconds == float("inf") else seconds):
                await turn.come()
        except TimeoutError:
            return not self.queue.leave(turn)
        except BaseException:
            if not self.queue.leave(turn):
                self.give_back(turn)
            raise
        return True

    def give_back(self, turn: TaskTurn) -> None:
        """End a turn, and wake the next task."""
        turn.is_over = True
        self.queue.hand_on()
