"""One line and its drives, for callers that await: the same verbs as `drivecomm.bus.bus`."""

from __future__ import annotations

import asyncio
from bisect import insort
from functools import partial
from threading import Lock
from typing import TYPE_CHECKING, Any, Self, TypeAlias, TypeVar, Unpack

from drivecomm.bus.faces import Awaited
from drivecomm.bus.lending import LentPort
from drivecomm.bus.opening import opened_with
from drivecomm.bus.priority_lock import Rank
from drivecomm.bus.procedures import carry_out_async, reaching
from drivecomm.bus.scanning import Found, Search
from drivecomm.bus.shared_bus import SharedBus
from drivecomm.bus.verbs import BroadcastVerbs, DriveVerbs
from drivecomm.errors import DeadlineError, LinkDownError, OvertakenError, PortError, ReplyError, UsageError
from drivecomm.polling import poll_async
from drivecomm.transport import in_own_thread, runner_for

if TYPE_CHECKING:
    from collections.abc import AsyncGenerator, AsyncIterator, Callable, Iterable

    from drivecomm.bus.faces import Job
    from drivecomm.bus.likely_settings import LineChoices
    from drivecomm.bus.opening import LineOptions
    from drivecomm.bus.procedures import Goal
    from drivecomm.bus.roster import Roster
    from drivecomm.link import Port, Steps
    from drivecomm.polling import PollItem, PollResult
    from drivecomm.protocol import DriveStatus
    from drivecomm.transport import Runner

T = TypeVar("T")


class AsyncDrive(DriveVerbs["AsyncBus"], Awaited):
    """One addressed drive, made by `AsyncBus.drive`; every verb is one exchange on the bus, and raises as `Drive`'s do.

    Cancelling a verb leaves the bus usable; whether the drive acted on a command that was cancelled is not known.
    """

    async def wait_for(self, goal: Goal, timeout_s: float = 10.0) -> DriveStatus:
        """Ask for the status until the drive is in a state, or "at_reference"; as `Drive.wait_for`."""
        return await carry_out_async(self, reaching(self.name, goal, timeout_s, self.bus.now))


class AsyncBroadcast(BroadcastVerbs["AsyncBus"], Awaited):
    """All drives of one protocol on a bus at once. Nobody answers, so nothing is known of what they did."""


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
        self._lock = AsyncPriorityLock()
        self._owner: asyncio.Task[Any] | None = None
        self._runner: Runner | None = None
        roster.link.stop_waits = self._lock.stop_waits

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
        for each in self._scan(search, progress, options):
            if isinstance(each, Found):
                # Reads files the first time.
                yield await asyncio.to_thread(search.model_of, each)
            else:
                each.found = await self.run(each.job)

    def poll(
        self, items: Iterable[PollItem[AsyncDrive]], *, duration_s: float | None = None, cycles: int | None = None
    ) -> AsyncGenerator[PollResult, None]:
        """Yield the results of a poll plan for drives on this bus; see `drivecomm.poll_async`."""
        return poll_async(self._on_this_bus(items, "drivecomm.poll_async"), duration_s=duration_s, cycles=cycles)

    async def run(self, job: Job[T]) -> T:
        """Carry out a job when it is its turn, as `Bus.run` does."""
        deadline = self._called(job)
        if job.rank is Rank.STOP:
            # Tasks that were made before this call and have not begun were asked for before it.
            await asyncio.sleep(0)
            self._roster.commands.stop_called(job.peer.name)
            return await self._stop(job, deadline)
        return await self._in_turn(job, job.rank, partial(self._begin, job, deadline))

    async def sleep_until(self, until: float) -> None:
        """Let time pass on the line's clock; others may use the line meanwhile."""
        left = until - self.now()
        if self._clock is None or self._clock.real_time:
            await asyncio.sleep(max(0.0, left))
            return
        await self._take_turn(Rank.POLL, float("inf"), "the bus")
        try:
            await asyncio.sleep(0)
            self._clock.wait(until)
        finally:
            self._give_back()

    async def lend(self, work: Callable[[Port, Port], T]) -> T:
        """Let a function have the port for itself, in a thread, as `Bus.lend` does; cancelling this ends it, too."""
        await self._take_turn(Rank.COMMAND, float("inf"), "the bus")
        wanted = True

        def carry_out() -> T:
            port = self._open_port()
            try:
                return work(port, LentPort(port, lambda: self._lock.stop_waits() or not wanted))
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
                raise
        finally:
            self._give_back()

    async def close(self) -> None:
        """Give the port back; the bus cannot be used any more."""
        await self._take_turn(Rank.COMMAND, float("inf"), "the bus")
        try:
            self._closed = True
            self._let_go()
            if self._on_close is not None:
                self._on_close()
        finally:
            self._give_back()

    async def __aenter__(self) -> Self:
        # Others may use it already, and one port is enough.
        await self._take_turn(Rank.COMMAND, float("inf"), "the bus")
        try:
            await self._opened()
        finally:
            self._give_back()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def _stop(self, job: Job[T], deadline: float) -> T:
        """Stop a drive. One that does not answer lets others go between its attempts, each of which is a turn then.

        So stops of dead drives do not hold up that of a running one, nor what feeds the watchdogs of others.
        """
        name, stopping, tried = job.peer.name, self._roster.commands.called(job.peer.name), self._tried_before(job)
        silent = was_silent = self._is_silent(name)
        rank, turns = Rank.STOP, job.peer.facts.timing.attempts if job.again is not None else 1
        while True:
            turns -= 1
            attempts = _Attempts(self._lock, silent=silent, turns=turns)
            begin = partial(self._begin, job, deadline, others_first=attempts.others_first)
            try:
                return await self._in_turn(job, rank, begin, last=silent, tried_before=tried)
            except (ReplyError, _OthersFirstError) as error:
                if not (attempts.broken_off and turns and job.again is not None):
                    raise
                if stopping.cancelled:
                    raise OvertakenError(f"{name} did not answer its stop, and a later one of it goes on") from error
            job, silent = job._replace(exchange=job.again()), True
            # What follows the first attempt to a drive that was silent before waits for the readings that came before
            # it, because these may keep the watchdogs of others quiet.
            rank = Rank.READ if was_silent else Rank.STOP

    def _is_silent(self, name: str) -> bool:
        """Whether a drive has not answered the last time it was asked."""
        health = self._roster.link.health.get(name)
        return health is not None and health.failed_calls > 0

    async def _in_turn(
        self,
        job: Job[T],
        rank: Rank,
        begin: Callable[[float], Steps[T]],
        *,
        last: bool = False,
        tried_before: int | None = None,
    ) -> T:
        """Carry out a job in its turn. begin: returns its steps. last: it queues behind all others of its rank.

        tried_before: how often the port was opened in vain before a stop was called for.
        """
        if self._lock.take_at_once():
            self._owner = asyncio.current_task()
        else:
            await self._take_turn(rank, job.peer.facts.timing.deadline_s, job.peer.name, last=last)
        try:
            runner = self._runner or await self._opened(tried_before)
            try:
                return self._timed(await runner.run(begin, self._lock.stop_waits))
            except LinkDownError:
                self._let_go()
                raise
        finally:
            self._give_back()

    async def _take_turn(self, rank: Rank, seconds: float, who: str, *, last: bool = False) -> None:
        if self._owner is not None and self._owner is asyncio.current_task():
            raise UsageError("a trace function cannot use the bus that calls it")
        if rank is Rank.STOP and self._runner is not None:
            self._runner.look()
        if not await self._lock.take(rank, seconds, last=last):
            raise DeadlineError(f"{who}: the line was busy with others for {seconds:g} s")
        self._owner = asyncio.current_task()

    def _give_back(self) -> None:
        self._owner = None
        self._lock.give_back()

    async def _opened(self, tried_before: int | None = None) -> Runner:
        if self._runner is not None:
            return self._runner
        self._check_backoff(tried_before)
        try:
            port = await self._new_port()
        except (PortError, LinkDownError):
            self._opening_failed()
            raise
        self._was_opened(port)
        self._runner = runner_for(port)
        return self._runner

    async def _new_port(self) -> Port:
        """Open the port in a thread; whoever is cancelled meanwhile leaves none open behind."""
        opening = _Opening(self._open_port)
        try:
            return await in_own_thread(opening.carry_out)
        except asyncio.CancelledError:
            opening.give_up()
            raise

    def _let_go(self) -> None:
        if self._runner is not None:
            self._runner.close()
            self._runner = None
        if self._port is not None:
            self._port.close()
            self._port = None


class _OthersFirstError(Exception):
    """An attempt to stop a drive has failed, and others wait for the line; the next one has a turn of its own."""


class _Attempts:
    """The attempts of a stop within one turn. silent: the drive is known not to answer. turns: how many may follow.

    broken_off: whether fewer were made than may be, because others wait.
    """

    def __init__(self, lock: AsyncPriorityLock, *, silent: bool, turns: int) -> None:
        self._lock = lock
        self._silent = silent
        self._turns = turns
        self.broken_off = False

    def others_first(self) -> bool:
        """Tell, when an attempt has failed, whether to ask no more in this turn.

        Where the drive answered before, raises _OthersFirstError: one telegram that was lost does not make its stop
        another one, such as coasting for a drive that does not say whether it can be stopped by its ramp.
        """
        if self._silent:
            self.broken_off = self.broken_off or self._lock.waits(Rank.READ)
        elif self._turns and self._lock.waits(Rank.STOP):
            self.broken_off = True
            raise _OthersFirstError
        return self.broken_off


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


_Place: TypeAlias = tuple[Rank, bool, int, "asyncio.Future[None]"]
"""A place in the queue: by rank, whether it is behind all others of its rank, and a number that no other has."""


class AsyncPriorityLock:
    """A line among tasks. It is handed from one to the next, so that nobody slips in between."""

    def __init__(self) -> None:
        self._taken = False
        self._waiting: list[_Place] = []
        self._order = 0

    def stop_waits(self) -> bool:
        """Whether somebody waits who wants to stop something."""
        return bool(self._waiting) and self._waiting[0][0] is Rank.STOP

    def waits(self, rank: Rank) -> bool:
        """Whether somebody of this rank waits, or of one that goes before it."""
        return bool(self._waiting) and self._waiting[0][0] <= rank

    def take_at_once(self) -> bool:
        """Have one's turn if it is nobody's; returns whether it is."""
        if self._taken:
            return False
        self._taken = True
        return True

    async def take(self, rank: Rank, seconds: float, *, last: bool = False) -> bool:
        """Wait for one's turn; returns False when it has not come within this time.

        last: let all others of this rank go first, whenever they come.
        """
        if self.take_at_once():
            return True
        self._order += 1
        called: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        place = (rank, last, self._order, called)
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
            *_, called = self._waiting.pop(0)
            if not called.done():
                called.set_result(None)
                return
        self._taken = False

    def _left(self, place: _Place) -> bool:
        """Wait no more; returns False when it was one's turn already."""
        if place in self._waiting:
            self._waiting.remove(place)
            return True
        return place[3].cancelled()
