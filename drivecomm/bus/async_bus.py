"""One line and its drives, for callers that await: the same verbs as `drivecomm.bus.bus`."""

from __future__ import annotations

import asyncio
from functools import partial
from threading import Lock
from typing import TYPE_CHECKING, Any, Self, TypeVar, Unpack

from drivecomm.bus.drives import AsyncBroadcast, AsyncDrive
from drivecomm.bus.lending import LentPort
from drivecomm.bus.opening import opened_with
from drivecomm.bus.procedures import carry_out_async
from drivecomm.bus.scanning import Found, Search
from drivecomm.bus.shared_bus import SharedBus
from drivecomm.bus.stopping_all import stopping_all
from drivecomm.errors import LinkDownError, OvertakenError, PortError, ReplyError
from drivecomm.line import Rank, TaskTurn, TaskTurns, in_own_thread, line_was_busy, poll_async, task_host_for
from drivecomm.link import HeldBack
from drivecomm.protocol import Stop

if TYPE_CHECKING:
    from collections.abc import AsyncGenerator, AsyncIterator, Callable, Iterable

    from drivecomm.bus.likely_settings import LineChoices
    from drivecomm.bus.opening import LineOptions
    from drivecomm.bus.roster import Roster
    from drivecomm.bus.scanning import Question
    from drivecomm.bus.stopping_all import OnResult, StopResult
    from drivecomm.line import Job, PollItem, PollResult, StopAttempts, TaskHost
    from drivecomm.link import Port
    from drivecomm.protocol import DriveConfig

T = TypeVar("T")


class AsyncBus(SharedBus[AsyncDrive, AsyncBroadcast]):
    """The master's side of one line, an asynchronous context manager; may be used by many tasks of one event loop.

    open_port: opens the port, on entering and again after it was lost; it may block, and does so in a thread. roster:
    the drives and what holds for all of them. on_close: called when the bus has been closed.
    """

    _drive = AsyncDrive
    _broadcast = AsyncBroadcast
    _opened_with = "open_bus_async"

    def __init__(
        self, open_port: Callable[[], Port], roster: Roster, on_close: Callable[[], None] | None = None
    ) -> None:
        super().__init__(open_port, roster, on_close)
        self._turns = TaskTurns()
        self.queue = self._turns.queue
        self._host: TaskHost | None = None
        roster.link.stop_waits = self._turns.stop_waits

    async def scan(
        self,
        only: Iterable[str] | None = None,
        addresses: Iterable[int] | None = None,
        *,
        choices: LineChoices | None = None,
        progress: Callable[[str, int, int], None] | None = None,
        **options: Any,
    ) -> AsyncIterator[Found]:
        """Yield the drives that answer, as `Bus.scan` does; sends only what cannot move a motor."""
        search = Search(only, addresses, choices)
        for each in self.questions(search, progress, options):
            if isinstance(each, Found):
                # Reads files the first time.
                yield await asyncio.to_thread(search.model_of, each)
            else:
                each.found = await self._asked(each)

    async def _asked(self, question: Question) -> Found | None:
        """Ask until no stop goes first."""
        while True:
            try:
                return await self.run(question.job)
            except OvertakenError:
                continue

    def poll(
        self, items: Iterable[PollItem[AsyncDrive]], *, duration_s: float | None = None, cycles: int | None = None
    ) -> AsyncGenerator[PollResult, None]:
        """Yield the results of a poll plan for drives on this bus; see `drivecomm.poll_async`."""
        return poll_async(self._on_this_bus(items, "drivecomm.poll_async"), duration_s=duration_s, cycles=cycles)

    async def stop_all(
        self,
        how: Stop = Stop.RAMP,
        *,
        drives: Iterable[DriveConfig] | None = None,
        on_result: OnResult | None = None,
    ) -> list[StopResult]:
        """Stop all motors of this line, and return what came of each stop; as `Bus.stop_all`."""
        there = self._roster.drives if drives is None else drives
        return await carry_out_async(None, stopping_all(self, there, how, on_result))

    async def run(self, job: Job[T]) -> T:
        """Carry out a job when it is its turn, as `Bus.run` does."""
        deadline = self._called(job)
        while job.rank is not Rank.STOP:
            try:
                return await self._run(job, deadline, TaskTurn(job.rank, self._look))
            except HeldBack as held:
                job = self._put_off(job, held)
                await self.sleep_until(held.until)
        # Tasks that were made before this call and have not begun were asked for before it.
        await asyncio.sleep(0)
        self._roster.commands.stop_called(job.peer.name)
        attempts, tried_before = self._attempts(job, self._turns.queue), self._failed_openings
        while True:
            turn = TaskTurn(attempts.rank, self._look, behind=attempts.behind)
            try:
                return await self._run(attempts.job, deadline, turn, attempts, tried_before)
            except ReplyError as error:
                attempts.after(error)

    async def sleep_until(self, until: float) -> None:
        """Let time pass on the line's clock; others may use the line meanwhile."""
        left = until - self.now()
        if self._clock is None or self._clock.real_time:
            await asyncio.sleep(max(0.0, left))
            return
        turn = await self._taken(Rank.POLL)
        try:
            await asyncio.sleep(0)
            self._clock.wait(until)
        finally:
            self._turns.give_back(turn)

    async def lend(self, work: Callable[[Port, Port], T]) -> T:
        """Let a function have the port for itself, in a thread, as `Bus.lend` does; cancelling this ends it, too."""
        turn = await self._taken(Rank.COMMAND)
        wanted = True

        def carry_out() -> T:
            port = self._open_port()
            try:
                return work(port, LentPort(port, lambda: self._turns.stop_waits() or not wanted))
            finally:
                port.close()

        try:
            self._let_go()
            working = asyncio.ensure_future(in_own_thread(carry_out))
            try:
                return await asyncio.shield(working)
            except asyncio.CancelledError:
                wanted = False
                await asyncio.wait([working])
                # Nobody else asks for what the borrower raises when the port is taken back.
                working.exception()
                raise
        finally:
            self._turns.give_back(turn)

    async def close(self) -> None:
        """Give the port back; the bus cannot be used any more."""
        turn = await self._taken(Rank.COMMAND)
        try:
            self._closed = True
            self._let_go()
            if self._on_close is not None:
                self._on_close()
        finally:
            self._turns.give_back(turn)

    async def __aenter__(self) -> Self:
        # Others may use it already, and one port is enough.
        turn = await self._taken(Rank.COMMAND)
        try:
            await self._opened()
        finally:
            self._turns.give_back(turn)
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def _run(
        self,
        job: Job[T],
        deadline: float,
        turn: TaskTurn,
        attempts: StopAttempts[T] | None = None,
        tried_before: int | None = None,
    ) -> T:
        """Carry out a job in one turn. tried_before: see `_check_backoff`."""
        await self._take(turn, job.peer.facts.timing.deadline_s, job.peer.name)
        try:
            host = self._host or await self._opened(tried_before)
            try:
                begin = partial(self._begin, job, deadline, attempts=attempts)
                return self._timed(await host.run(begin, self._turns.stop_waits))
            except LinkDownError:
                self._let_go()
                raise
        finally:
            self._turns.give_back(turn)

    async def _taken(self, rank: Rank) -> TaskTurn:
        """Wait, however long, until nobody else has the line; returns the turn, which has to be given back."""
        turn = TaskTurn(rank, self._look)
        await self._take(turn, float("inf"), "the bus")
        return turn

    async def _take(self, turn: TaskTurn, seconds: float, who: str) -> None:
        if not await self._turns.take(turn, seconds):
            raise line_was_busy(who, seconds)

    def _look(self) -> None:
        """Have the host look whether a stop waits."""
        if self._host is not None:
            self._host.look()

    async def _opened(self, tried_before: int | None = None) -> TaskHost:
        if self._host is not None:
            return self._host
        self._check_backoff(tried_before)
        try:
            port = await self._new_port()
        except (PortError, LinkDownError):
            self._opening_failed()
            raise
        self._was_opened(port)
        self._host = task_host_for(port)
        return self._host

    async def _new_port(self) -> Port:
        """Open the port in a thread; whoever is cancelled meanwhile leaves none open behind."""
        opening = _Opening(self._open_port)
        try:
            return await in_own_thread(opening.carry_out)
        except asyncio.CancelledError:
            opening.give_up()
            raise

    def _let_go(self) -> None:
        if self._host is not None:
            self._host.close()
            self._host = None
        if self._port is not None:
            self._port.close()
            self._port = None


class _Opening:
    """Opens a port in a thread, for somebody who may not want it any more when it is open."""

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


def open_bus_async(port: str | Callable[[], Port], **options: Unpack[LineOptions]) -> AsyncBus:
    """Return the bus of a line for `async with`, which opens it; the arguments are those of `open_bus`.

    Entering raises PortError when the port does not exist or is in use.
    """
    return AsyncBus(*opened_with(port, options))
