"""Standing stops: retried until the drive confirms, is started again, or leaves the plant.

A stop is confirmed when the drive has acknowledged its telegram. The motor may still be ramping down then; a confirmed
stop is not sent again. Neither a telegram that went out nor a status "not running" confirms a stop.
"""

from __future__ import annotations

import asyncio
import time
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from itertools import count
from typing import TYPE_CHECKING

from drivecomm.errors import DriveCommError, in_one_line
from drivecomm.link import Backoff
from drivecomm.plant.watching import is_silence
from drivecomm.server.observations import StandingStop

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine, Iterable, Iterator, Sequence

    from drivecomm.protocol import Stop
    from drivecomm.server.table import ValueTable

AGAIN_FIRST_S, AGAIN_LONGEST_S = 0.5, 2.0
"""The first and the longest pause between two attempts."""
LEAST_GAP_S = 0.2
"""The shortest pause between two attempts, also before a running drive is stopped again."""
_REST = 4
"""Silent drives take a fifth of a line at most: each one rests for this multiple of the duration of an attempt."""
LAST_TRY_S = 2.0
"""Time limit of the last attempts when the server ends."""


@dataclass(slots=True, eq=False)
class _Standing:
    """A standing stop. silent: the last attempt got no reply. starts: number of starts under way; they hold it back."""

    how: Stop
    who: str
    told: bool = False
    silent: bool = False
    starts: int = 0
    since_s: float = field(default_factory=time.time)
    woken: asyncio.Event = field(default_factory=asyncio.Event)
    over: asyncio.Event = field(default_factory=asyncio.Event)
    task: asyncio.Task[None] = field(init=False)


class StandingStops:
    """The standing stops of a plant, at most one for each drive: a later one replaces an earlier one.

    send: makes one attempt to stop a drive, reports success by `confirmed`, and raises otherwise. Used from the core's
    event loop; `of` and `drives` from any thread.
    """

    def __init__(self, table: ValueTable, send: Callable[[str, Stop], Coroutine[object, object, None]]) -> None:
        self._table, self._send = table, send
        self._standing: dict[str, _Standing] = {}
        self._numbers = count(1)
        self._latest: dict[str, int] = {}
        self._finished = False

    @property
    def drives(self) -> Sequence[str]:
        """The drives with a standing stop."""
        return tuple(self._standing)

    def of(self, drive: str) -> StandingStop | None:
        """Return the standing stop of a drive, or None without one; a stop that has not failed yet is left out."""
        stop = self._standing.get(drive)
        if stop is None or not stop.told:
            return None
        return StandingStop(how=stop.how, who=stop.who, since_s=stop.since_s)

    def sent(self, drives: Iterable[str], how: Stop) -> int:
        """Record that a stop of these drives is about to be sent, and return its number.

        A stop that still stands for one of them is retried with the new kind. Otherwise the retry would follow the new
        stop and stop the motor in another way.
        """
        number = next(self._numbers)
        for drive in drives:
            self._latest[drive] = number
            if (stop := self._standing.get(drive)) is not None:
                stop.how = how
        return number

    def stand(self, drive: str, how: Stop, who: str, number: int, error: Exception) -> None:
        """Retry a stop that was not confirmed, unless a later stop of the drive has been sent. number: from `sent`."""
        if self._finished or self._latest.get(drive, 0) > number:
            return
        stop = self._begun(drive, how, who)
        self._not_confirmed(drive, stop, error)

    def send_soon(self, drive: str, how: Stop, who: str) -> None:
        """Send a stop now, and retry it until it is confirmed."""
        if not self._finished:
            self._begun(drive, how, who).woken.set()

    def confirmed(self, drive: str) -> None:
        """Record that a drive has acknowledged a stop."""
        stop = self._standing.get(drive)
        if stop is not None:
            self._ended(drive, stop)
            if stop.told:
                self._table.record_event("command", f"stop ({stop.how.value}) confirmed", drive=drive, who=stop.who)

    def end(self, drive: str, why: str) -> None:
        """Cancel the standing stop of a drive, and report the reason."""
        stop = self._standing.get(drive)
        if stop is not None:
            self._ended(drive, stop)
            text = f"stop ({stop.how.value}) was not confirmed, and is retried no longer: {why}"
            self._table.record_event("warning", text, drive=drive, who=stop.who)

    @contextmanager
    def giving_way(self, drive: str, who: str) -> Iterator[None]:
        """Hold back the standing stop of a drive during a start; a successful start ends the stop."""
        stop = self._standing.get(drive)
        if stop is None:
            yield
            return
        stop.starts += 1
        try:
            yield
            if self._standing.get(drive) is stop:
                if stop.told:
                    self.end(drive, f"{drive} was started by {who}")
                else:
                    self._ended(drive, stop)
        finally:
            stop.starts -= 1
            stop.woken.set()

    def seen(self, drive: str, *, running: bool) -> None:
        """Send the standing stop now if the drive runs, or if it has answered after a silence."""
        stop = self._standing.get(drive)
        if stop is not None and (running or stop.silent):
            stop.woken.set()

    async def until_over(self, drive: str) -> None:
        """Wait until a drive has no standing stop."""
        while (stop := self._standing.get(drive)) is not None:
            await stop.over.wait()

    async def finish(self) -> None:
        """Try all standing stops one last time and report those that remain, because the server ends."""
        self._finished = True
        stops = dict(self._standing)
        for stop in stops.values():
            stop.task.cancel()
        await asyncio.gather(*(self._try_last(drive, stop) for drive, stop in stops.items()))
        for drive in list(self._standing):
            self.end(drive, "the server ends")

    def _begun(self, drive: str, how: Stop, who: str) -> _Standing:
        earlier = self._standing.get(drive)
        if earlier is not None and not earlier.starts:
            earlier.how, earlier.who = how, who
            return earlier
        if earlier is not None:
            # The start under way must end the earlier stop only, not the new one.
            self._ended(drive, earlier)
        stop = self._standing[drive] = _Standing(how, who, told=earlier is not None and earlier.told)
        stop.task = asyncio.create_task(self._retry(drive, stop), name=f"stopping {drive}")
        return stop

    def _ended(self, drive: str, stop: _Standing) -> None:
        del self._standing[drive]
        stop.over.set()
        if stop.task is not asyncio.current_task():
            stop.task.cancel()

    async def _retry(self, drive: str, stop: _Standing) -> None:
        waiting, loop = Backoff(AGAIN_FIRST_S, AGAIN_LONGEST_S), asyncio.get_running_loop()
        least_s = 0.0
        while True:
            waiting.failed(loop.time(), least_s)
            await self._pause(stop, waiting.over_at - loop.time())
            began_s = loop.time()
            try:
                await self._send(drive, stop.how)
            except Exception as error:  # noqa: BLE001 - after any error the stop is unconfirmed
                self._not_confirmed(drive, stop, error)
            if stop.over.is_set():
                return
            least_s = (loop.time() - began_s) * _REST * len(self._standing) if stop.silent else 0.0
            await asyncio.sleep(LEAST_GAP_S)

    async def _pause(self, stop: _Standing, seconds: float) -> None:
        """Wait for these seconds or until woken; then, if a start is under way, wait until it has ended."""
        with suppress(TimeoutError):
            async with asyncio.timeout(seconds):
                await stop.woken.wait()
        stop.woken.clear()
        while stop.starts:
            await stop.woken.wait()
            stop.woken.clear()

    async def _try_last(self, drive: str, stop: _Standing) -> None:
        with suppress(Exception):
            async with asyncio.timeout(LAST_TRY_S):
                await self._send(drive, stop.how)

    def _not_confirmed(self, drive: str, stop: _Standing, error: Exception) -> None:
        stop.silent = isinstance(error, DriveCommError) and is_silence(error)
        if not stop.told:
            stop.told = True
            text = f"stop ({stop.how.value}) not confirmed; retrying until the drive answers: {in_one_line(error)}"
            self._table.record_event("warning", text, drive=drive, who=stop.who)
