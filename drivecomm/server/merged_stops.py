"""Concurrent stops of one drive, merged into one job on its line."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine, Hashable

    from drivecomm.protocol import Stop

STOP_REST_S = 0.1
"""Pause before the same stop is sent again, unless its line is commanded: repeated stops leave the line to others."""


class StopKey(NamedTuple):
    """The identity of a stop: stops with equal keys are merged.

    drive: as its bus names it, or PROTOCOL:*. options: the caller's own settings of the drive.
    """

    line: str
    drive: str
    how: Stop
    options: str = ""


@dataclass(slots=True, eq=False)
class StopJob:
    """A stop on its way to a line.

    goes_out: must be called right before its first telegram; after that no other stop joins it. number: its place among
    all stops, 0 until it is sent. callers: callers whose request is recorded.
    """

    goes_out: Callable[[], None]
    number: int = 0
    callers: set[Hashable] = field(default_factory=set)
    task: asyncio.Task[None] = field(init=False)


class MergedStops:
    """The stop jobs of a server: a stop joins an equal one whose telegram has not gone out yet.

    Used within one event loop.
    """

    def __init__(self) -> None:
        self._waiting: dict[StopKey, StopJob] = {}
        self._rests: dict[StopKey, asyncio.Event] = {}
        self._tasks: set[asyncio.Task[None]] = set()

    def job(self, key: StopKey, send: Callable[[StopJob], Coroutine[object, object, None]]) -> StopJob:
        """Return the job of a stop: an equal one that still waits, otherwise a new one carried out by `send`."""
        if (waiting := self._waiting.get(key)) is not None:
            return waiting
        job = self._waiting[key] = StopJob(lambda: self._goes_out(key, job))
        job.task = asyncio.create_task(self._carry_out(key, job, send), name=f"stop of {key.drive}")
        self._tasks.add(job.task)
        job.task.add_done_callback(self._done)
        return job

    def commanded(self, line: str) -> None:
        """End the pauses of a line before a command is sent on it.

        A stop that was requested before the command must also go out before it.
        """
        for key in [key for key in self._rests if key.line == line]:
            self._rested(key, self._rests[key])

    async def close(self) -> None:
        """Cancel all unsent stops."""
        tasks = list(self._tasks)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    async def _carry_out(
        self, key: StopKey, job: StopJob, send: Callable[[StopJob], Coroutine[object, object, None]]
    ) -> None:
        try:
            if (before := self._rests.get(key)) is not None:
                await before.wait()
            rest = self._rests[key] = asyncio.Event()
            try:
                await send(job)
            finally:
                asyncio.get_running_loop().call_later(STOP_REST_S, self._rested, key, rest)
        finally:
            self._goes_out(key, job)

    def _goes_out(self, key: StopKey, job: StopJob) -> None:
        if self._waiting.get(key) is job:
            del self._waiting[key]

    def _rested(self, key: StopKey, rest: asyncio.Event) -> None:
        rest.set()
        if self._rests.get(key) is rest:
            del self._rests[key]

    def _done(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        if not task.cancelled():
            # Marks the exception as retrieved: all callers may have gone.
            task.exception()
