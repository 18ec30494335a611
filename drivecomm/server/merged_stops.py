"""Concurrent stops of one drive, merged into one job on its line."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine, Hashable

    from drivecomm.protocol import Stop

STOP_REST_S = 0.1
"""Pause between a stop and the same again, unless its line is commanded: a flood of stops leaves the line to others."""


class StopKey(NamedTuple):
    """What makes two stops the same. drive: as its bus names it, or PROTOCOL:*. options: what the caller says of it."""

    line: str
    drive: str
    how: Stop
    options: str = ""


@dataclass(slots=True, eq=False)
class StopJob:
    """One stop on its way to a line.

    goes_out: to be called right before its first telegram; no other stop joins it then. number: its place among all
    stops, 0 until it is sent. callers: those whose request is recorded.
    """

    goes_out: Callable[[], None]
    number: int = 0
    callers: set[Hashable] = field(default_factory=set)
    task: asyncio.Task[None] = field(init=False)


class MergedStops:
    """Lets a stop join an equal one whose telegram has not gone out yet. Used within one event loop."""

    def __init__(self) -> None:
        self._waiting: dict[StopKey, StopJob] = {}
        self._rests: dict[StopKey, asyncio.Event] = {}
        self._tasks: set[asyncio.Task[None]] = set()

    def job(self, key: StopKey, send: Callable[[StopJob], Coroutine[object, object, None]]) -> StopJob:
        """Return the job of this stop: the one that waits for its line, otherwise a new one carried out by `send`."""
        if (waiting := self._waiting.get(key)) is not None:
            return waiting
        job = self._waiting[key] = StopJob(lambda: self._goes_out(key, job))
        job.task = asyncio.create_task(self._carry_out(key, job, send), name=f"stop of {key.drive}")
        self._tasks.add(job.task)
        job.task.add_done_callback(self._done)
        return job

    def commanded(self, line: str) -> None:
        """End the rests of a line, because a command follows: a stop that was asked for before it goes out before."""
        for key in [key for key in self._rests if key.line == line]:
            self._rested(key, self._rests[key])

    async def close(self) -> None:
        """Cancel what has not been sent."""
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
            # Marks it as seen: all of its callers may have gone.
            task.exception()
