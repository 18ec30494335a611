"""One line and its drives, for callers that await: the same verbs as `drivecomm.bus.bus`."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any, Self, TypeVar

from drivecomm.bus.async_drive import AsyncBroadcast, AsyncDrive
from drivecomm.bus.async_turns import AsyncTurns
from drivecomm.bus.bus import REOPEN_FIRST_S, REOPEN_LONGEST_S, port_opener
from drivecomm.bus.roster import Roster, echo_mode, line_overrides
from drivecomm.bus.scanning import Found, Search, introduce, look
from drivecomm.bus.stored_writes import ALLOWED, StoredWrites
from drivecomm.bus.turns import Rank
from drivecomm.errors import DeadlineError, LinkDownError, PortError, UsageError
from drivecomm.link import GrowingPause
from drivecomm.polling import poll_async
from drivecomm.transport import runner_for

if TYPE_CHECKING:
    from collections import Counter
    from collections.abc import AsyncGenerator, AsyncIterator, Callable, Iterable, Mapping
    from pathlib import Path
    from types import TracebackType

    from drivecomm.bus.likely_settings import LineChoices
    from drivecomm.capture import Record
    from drivecomm.link import CommandCall, Echo, Health, Party, Port, Statistics, Steps, TraceEvent
    from drivecomm.polling import PollItem, PollResult
    from drivecomm.protocol import Exchange, Model, Parity, Reading
    from drivecomm.transport import Runner

T = TypeVar("T")
R = TypeVar("R", "Reading", "Reading | None")

_CLOSED = "this bus is closed; open it again with open_bus_async"


class AsyncBus:
    """The master's side of one line, an asynchronous context manager; may be used by many tasks of one event loop.

    open_port: opens the port, on entering and again after it was lost; it may block, and does so in a thread. roster:
    the drives and what holds for all of them. on_close: called when the bus has been closed.
    """

    def __init__(
        self, open_port: Callable[[], Port], roster: Roster, on_close: Callable[[], None] | None = None
    ) -> None:
        self._open_port = open_port
        self._roster = roster
        self._on_close = on_close
        self._turns = AsyncTurns()
        self._owner: asyncio.Task[Any] | None = None
        self._closed = False
        self._reopening = GrowingPause(REOPEN_FIRST_S, REOPEN_LONGEST_S)
        self._port: Port | None = None
        self._clock: Port | None = None
        self._runner: Runner | None = None
        roster.link.stop_waits = self._turns.stop_waits

    def drive(
        self,
        protocol: str,
        address: int,
        *,
        model: str | Path | Model | None = None,
        set_up: Mapping[str, Any] | None = None,
        read_only: str = "",
        **options: Any,
    ) -> AsyncDrive:
        """Return the drive at an address; nothing is sent. The arguments are those of `Bus.drive`."""
        member = self._roster.member(protocol, address, model, set_up, options, read_only=read_only)
        self._roster.add(member.party.name)
        return AsyncDrive(self, *member)

    def broadcast(self, protocol: str, *, model: str | Path | Model | None = None, **options: Any) -> AsyncBroadcast:
        """Return all drives of a protocol at once; what is sent to them is never answered."""
        member = self._roster.all_drives(protocol, model, options)
        return AsyncBroadcast(self, member.party, member.operations)

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
        asking = None
        for asking in search:
            if progress is not None:
                progress(str(asking), search.done, search.total)
            member = self._roster.member(asking.protocol, asking.address, None, None, {**asking.options, **options})
            seen = await self.insist(member.party, look(asking, member.operations, member.party.facts.settings))
            found = search.heard(asking, seen)
            if found is not None and found.sound:
                found = await self.insist(member.party, introduce(found, member.operations))
                # Reads files the first time.
                found = await asyncio.to_thread(search.model_of, found)
            if found is not None:
                yield found
        for each in search.damaged():
            yield each
        if progress is not None and asking is not None:
            progress(str(asking), search.total, search.total)

    def poll(
        self, items: Iterable[PollItem[AsyncDrive]], *, duration_s: float | None = None, cycles: int | None = None
    ) -> AsyncGenerator[PollResult, None]:
        """Yield the results of a poll plan for drives on this bus; see `drivecomm.poll_async`."""
        plan = list(items)
        for item in plan:
            if item.drive.bus is not self:
                raise UsageError(f"{item.drive.name} is not on this bus; poll it with drivecomm.poll_async")
        return poll_async(plan, duration_s=duration_s, cycles=cycles)

    async def run(
        self, party: Party, exchange: Exchange[T], rank: Rank = Rank.READ, command: CommandCall | None = None
    ) -> T:
        """Carry out an exchange with a drive, unless the drive is known not to answer; waits for its turn.

        A port that was lost is opened again first. Raises DeadlineError when the drive's deadline_s passes, and
        CommandCancelledError for a command that a stop has cancelled.
        """
        deadline = self.now() + party.facts.timing.deadline_s
        steps = self._roster.link.run(party, exchange, deadline=deadline, command=command)
        return (await self._in_turn(steps, party, rank))[0]

    async def reading(
        self, party: Party, exchange: Exchange[R], rank: Rank = Rank.READ, command: CommandCall | None = None
    ) -> R:
        """Carry out an exchange as `run` does; the reading that it results in gets the time of its reply."""
        deadline = self.now() + party.facts.timing.deadline_s
        steps = self._roster.link.run(party, exchange, deadline=deadline, command=command)
        result, time_s = await self._in_turn(steps, party, rank)
        return result and result.at(time_s)

    async def insist(self, party: Party, exchange: Exchange[T]) -> T:
        """Carry out an exchange whatever is known of the drive; waits for its turn."""
        deadline = self.now() + party.facts.timing.deadline_s
        return (await self._in_turn(self._roster.link.insist(party, exchange, deadline=deadline), party, Rank.READ))[0]

    async def stop(self, party: Party, exchange: Exchange[T]) -> T:
        """Carry out an exchange that stops a motor, or all of a protocol; see `drivecomm.link.command_order`."""
        deadline = self.now() + party.facts.timing.deadline_s
        self._roster.commands.stop_called(party.name)
        # Tasks that were made before this call and have not begun were asked for before it.
        await asyncio.sleep(0)
        self._roster.commands.stop_called(party.name)
        stopping = self._roster.stopping(party, exchange)
        return (await self._in_turn(self._roster.link.stop(party, stopping, deadline=deadline), party, Rank.STOP))[0]

    def command(self, party: Party) -> CommandCall:
        """Take note that a drive, or all drives of a protocol, are to be commanded; a later stop cancels that."""
        return self._roster.commands.called(party.name)

    def watched(self, party: Party, silence_s: float | None) -> None:
        """Take note how long a drive's watchdog waits; None when it is off, or not known."""
        self._roster.commands.watch(party.name, silence_s)
        self._roster.link.repeat_within(party, float("inf") if silence_s is None else silence_s)

    def storing(self, party: Party, parameter: str) -> None:
        """Count a write that may end in EEPROM. Raises UsageError for one too many within an hour."""
        self._roster.stored_writes.count(party.name, parameter, self.now())

    def now(self) -> float:
        """Return the time on the line's clock, in seconds; its beginning means nothing."""
        if self._closed:
            raise UsageError(_CLOSED)
        if self._clock is None:
            raise UsageError("this bus is not open; use it in `async with`")
        return self._clock.now()

    @property
    def real_time(self) -> bool:
        """Whether time passes by itself, as it does everywhere but on a virtual line."""
        return self._clock is None or self._clock.real_time

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

    def wall_time(self) -> float:
        """Return the time in seconds since 1970 (on a virtual line: since its start), 0 before it was opened."""
        return 0.0 if self._clock is None else self._clock.wall_time()

    @property
    def counters(self) -> Mapping[str, Counter[str]]:
        """What happened so far, by drive: requests, replies, retries, timeouts, and each kind of error."""
        return self._roster.link.counters

    @property
    def statistics(self) -> Mapping[str, Statistics]:
        """The counters and the reply times, by drive."""
        return self._roster.link.statistics

    @property
    def health(self) -> Mapping[str, Health]:
        """Whether the drives answer, by name."""
        return self._roster.link.health

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
        await self._opened()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        await self.close()

    async def _in_turn(self, steps: Steps[T], party: Party, rank: Rank) -> tuple[T, float]:
        await self._take_turn(rank, party.facts.timing.deadline_s, party.name)
        try:
            runner = await self._opened()
            try:
                result = await runner.run(steps, self._turns.stop_waits)
            except LinkDownError:
                self._let_go()
                raise
            return result, self.wall_time()
        finally:
            self._give_back()

    async def _take_turn(self, rank: Rank, seconds: float, who: str) -> None:
        if self._owner is not None and self._owner is asyncio.current_task():
            raise UsageError("a trace function cannot use the bus that calls it")
        if rank is Rank.STOP and self._runner is not None:
            self._runner.look()
        if not await self._turns.take(rank, seconds):
            raise DeadlineError(f"{who}: the line was busy with others for {seconds:g} s")
        self._owner = asyncio.current_task()

    def _give_back(self) -> None:
        self._owner = None
        self._turns.give_back()

    async def _opened(self) -> Runner:
        if self._runner is not None:
            return self._runner
        if self._closed:
            raise UsageError(_CLOSED)
        if self._clock is not None and (now := self._clock.now()) < self._reopening.over_at:
            raise LinkDownError(f"the port was lost; it is opened again in {self._reopening.over_at - now:.1f} s")
        try:
            port = await self._new_port()
        except (PortError, LinkDownError):
            if self._clock is not None:
                self._reopening.failed(self._clock.now())
            raise
        self._reopening.succeeded()
        if self._clock is not None:
            self._roster.link.reopened()
        self._port = self._clock = port
        self._roster.link.paced = port.paced
        self._runner = runner_for(port)
        return self._runner

    async def _new_port(self) -> Port:
        """Open the port in a thread; whoever is cancelled meanwhile leaves none open behind."""
        opening = asyncio.ensure_future(asyncio.to_thread(self._open_port))
        try:
            return await asyncio.shield(opening)
        except asyncio.CancelledError:
            opening.add_done_callback(_close_port)
            raise

    def _let_go(self) -> None:
        if self._runner is not None:
            self._runner.close()
            self._runner = None
        if self._port is not None:
            self._port.close()
            self._port = None


def _close_port(opening: asyncio.Future[Port]) -> None:
    if not opening.cancelled() and opening.exception() is None:
        opening.result().close()


def open_bus_async(
    port: str | Callable[[], Port],
    *,
    baudrate: int | None = None,
    bytesize: int | None = None,
    parity: Parity | None = None,
    stopbits: float | None = None,
    reply_timeout_s: float | None = None,
    attempts: int | None = None,
    echo: bool | Echo = "off",
    guard_s: float = 0.005,
    rs485: bool = False,
    low_latency: bool | None = None,
    trace: Callable[[TraceEvent], None] | None = None,
    record: Record | None = None,
    stored_writes_per_hour: int = ALLOWED,
    **facts: float | None,
) -> AsyncBus:
    """Return the bus of a line for `async with`, which opens it; the arguments are those of `open_bus`.

    Entering raises PortError when the port does not exist or is in use.
    """
    given = {
        "baudrate": baudrate,
        "bytesize": bytesize,
        "parity": parity,
        "stopbits": stopbits,
        "reply_timeout_s": reply_timeout_s,
        "attempts": attempts,
        **facts,
    }
    roster = Roster(
        overrides=line_overrides(given),
        trace=trace,
        echo=echo_mode(echo),
        guard_s=guard_s,
        stored_writes=StoredWrites(stored_writes_per_hour),
    )
    opener = port_opener(port, rs485=rs485, low_latency=low_latency)
    if record is None:
        return AsyncBus(opener, roster)
    # Files and their formats are for those who record.
    from drivecomm.capture import Recording  # noqa: PLC0415

    name = port if isinstance(port, str) else ""
    recording = Recording(opener, record, name=name, echo=echo_mode(echo), drives=roster.names)
    return AsyncBus(recording.open_port, roster, recording.close)
