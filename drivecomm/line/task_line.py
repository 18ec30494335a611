"""Line for the tasks of one event loop: the asynchronous counterpart of `drivecomm.line.thread_line`."""

from __future__ import annotations

import asyncio
from functools import partial
from threading import Lock
from typing import TYPE_CHECKING, TypeVar

from drivecomm.errors import LinkDownError, PortError, ReplyError
from drivecomm.line.lent_port import LentPort
from drivecomm.line.own_thread import in_own_thread
from drivecomm.line.owner import LineOwner
from drivecomm.line.queue import Rank, line_was_busy
from drivecomm.line.task_hosts import task_host_for
from drivecomm.line.task_turns import TaskTurn, TaskTurns
from drivecomm.line.uncancelled import result_of
from drivecomm.link import HeldBack

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.line.job import Job
    from drivecomm.line.stopping import StopAttempts
    from drivecomm.line.task_hosts import TaskHost
    from drivecomm.link import Port

T = TypeVar("T")


class TaskLine(LineOwner):
    """One line among tasks; the arguments are those of `LineOwner`.

    open_port: may block, so it runs in a thread. turns: hands the line from task to task. host: waits for the port;
    None while it is not open.
    """

    host: TaskHost | None = None
    turns: TaskTurns

    _opened_with = "open_bus_async"
    _new_turns = TaskTurns

    async def run(self, job: Job[T]) -> T:
        """Carry out a job when its turn comes, as `ThreadLine.run` does; a cancellation leaves the line usable."""
        deadline = self.called(job)
        while job.rank is not Rank.STOP:
            try:
                return await self._run(job, deadline, TaskTurn(job.rank, self._look))
            except HeldBack as held:
                job = self.put_off(job, held)
                await self.sleep_until(held.until)
        # Tasks that were created before this stop, but not started yet, count as called before it.
        await asyncio.sleep(0)
        self._commands.stop_called(job.peer.name)
        attempts, tried_before = self.attempts(job), self.failed_openings
        while True:
            turn = TaskTurn(attempts.rank, self._look, behind=attempts.behind)
            try:
                return await self._run(attempts.job, deadline, turn, attempts, tried_before)
            except ReplyError as error:
                attempts.after(error)

    async def _run(
        self,
        job: Job[T],
        deadline: float,
        turn: TaskTurn,
        attempts: StopAttempts[T] | None = None,
        tried_before: int | None = None,
    ) -> T:
        """Carry out a job in one turn. tried_before: see `check_backoff`."""
        await self._take(turn, job.peer.facts.timing.deadline_s, job.peer.name)
        try:
            host = self.host or await self._opened(tried_before)
            try:
                begin = partial(self.begin, job, deadline, attempts=attempts)
                return self.with_time(await host.run(begin, self.turns.stop_waits))
            except LinkDownError:
                self.let_go()
                raise
        finally:
            self.turns.give_back(turn)

    async def open(self) -> None:
        """Open the port, unless it is open. Raises PortError if it cannot be opened."""
        # Other tasks may use the line already, and must not open a second port.
        turn = await self.taken(Rank.COMMAND)
        try:
            await self._opened(None)
        finally:
            self.turns.give_back(turn)

    async def sleep_until(self, until: float) -> None:
        """Wait until this time on the line's clock; other tasks may use the line meanwhile."""
        left = until - self.now()
        if self.clock is None or self.clock.real_time:
            await asyncio.sleep(max(0.0, left))
            return
        turn = await self.taken(Rank.POLL)
        try:
            await asyncio.sleep(0)
            self.clock.wait(until)
        finally:
            self.turns.give_back(turn)

    async def lend(self, work: Callable[[Port, Port], T]) -> T:
        """Lend the port to a function in a thread, as `ThreadLine.lend` does; a cancellation takes the port back."""
        turn = await self.taken(Rank.COMMAND)
        wanted = True

        def check() -> None:
            self.check_no_stop_waits()
            if not wanted:
                raise LinkDownError("the port was given back in the middle, because its borrower was cancelled")

        def carry_out() -> T:
            port = self.open_port()
            try:
                return work(port, LentPort(port, check))
            finally:
                port.close()

        try:
            self.let_go()
            working = asyncio.ensure_future(in_own_thread(carry_out))
            try:
                return await result_of(working)
            except asyncio.CancelledError:
                wanted = False
                await asyncio.wait([working])
                raise
        finally:
            self.turns.give_back(turn)

    async def close(self) -> None:
        """Close the port for good; the line cannot be used any more."""
        turn = await self.taken(Rank.COMMAND)
        try:
            self.shut()
        finally:
            self.turns.give_back(turn)

    async def taken(self, rank: Rank) -> TaskTurn:
        """Wait without limit for the line, and return the turn, which must be given back."""
        turn = TaskTurn(rank, self._look)
        await self._take(turn, float("inf"), "the bus")
        return turn

    async def _take(self, turn: TaskTurn, seconds: float, who: str) -> None:
        if not await self.turns.take(turn, seconds):
            raise line_was_busy(who, seconds)

    def _look(self) -> None:
        """Make the host check whether a stop waits."""
        if self.host is not None:
            self.host.look()

    async def _opened(self, tried_before: int | None) -> TaskHost:
        if self.host is not None:
            return self.host
        self.check_backoff(tried_before)
        try:
            port = await self._new_port()
        except (PortError, LinkDownError):
            self.opening_failed()
            raise
        self.was_opened(port)
        self.host = task_host_for(port)
        return self.host

    async def _new_port(self) -> Port:
        """Open the port in a thread; after a cancellation the port is closed again."""
        opening = _Opening(self.open_port)
        try:
            return await in_own_thread(opening.carry_out)
        except asyncio.CancelledError:
            opening.give_up()
            raise

    def let_go(self) -> None:
        """Close the port, if it is open; the next call opens it again."""
        if self.host is not None:
            self.host.close()
            self.host = None
        super().let_go()


class _Opening:
    """Opening of a port in a thread, for a caller that may give up before the port is open."""

    def __init__(self, open_port: Callable[[], Port]) -> None:
        self._open_port = open_port
        self._lock = Lock()
        self._given_up = False
        self._port: Port | None = None

    def carry_out(self) -> Port:
        port = self._open_port()
        with self._lock:
            self._port = port
            if self._given_up:
                port.close()
        return port

    def give_up(self) -> None:
        with self._lock:
            self._given_up = True
            if self._port is not None:
                self._port.close()
