"""Turns on a line for the tasks of one event loop."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

from drivecomm.line.queue import LineQueue, QueueEntry, Rank

if TYPE_CHECKING:
    from collections.abc import Callable


class TaskTurn(QueueEntry):
    """Turn of one call of the running task. on_stop: called when a stop begins to wait while this turn has the line."""

    __slots__ = ("_called", "_on_stop", "is_over")

    def __init__(self, rank: Rank, on_stop: Callable[[], None], *, behind: bool = False) -> None:
        super().__init__(rank, asyncio.current_task(), behind=behind)
        self.is_over = False
        self._called: asyncio.Future[None] | None = None
        self._on_stop = on_stop

    def is_alive(self) -> bool:
        """Return whether the turn is not over, and its task was not cancelled while waiting."""
        return not self.is_over and (self._called is None or not self._called.cancelled())

    def begin_waiting(self) -> None:
        """Create the future that the task awaits."""
        self._called = asyncio.get_running_loop().create_future()

    def wake(self) -> None:
        """Continue the task."""
        if self._called is not None and not self._called.done():
            self._called.set_result(None)

    def give_way(self) -> None:
        """Make the host check immediately whether it gives way."""
        self._on_stop()

    async def come(self) -> None:
        """Wait to be woken."""
        if self._called is not None:
            await self._called


class TaskTurns:
    """Turns of one line among tasks."""

    def __init__(self) -> None:
        self.queue = LineQueue()
        self.stop_waits = self.queue.stop_waits

    async def take(self, turn: TaskTurn, seconds: float) -> bool:
        """Wait for a turn; return False if it does not come within this time. Raises the errors of `LineQueue.ask`."""
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
