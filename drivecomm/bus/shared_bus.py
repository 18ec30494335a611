"""What a bus does without waiting, for `Bus` and `AsyncBus` alike: its drives, its clock, and what it takes note of."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Generic, TypeVar

from drivecomm.errors import HeldBackError, LinkDownError, UsageError
from drivecomm.line import Job, Rank, StopAttempts
from drivecomm.link import REOPEN_FIRST_S, REOPEN_LONGEST_S, Backoff, tell_all
from drivecomm.protocol import Reading

if TYPE_CHECKING:
    from collections import Counter
    from collections.abc import Callable, Iterable, Iterator, Mapping
    from pathlib import Path

    from drivecomm.bus.engine_line import EngineLine
    from drivecomm.bus.roster import Member, Roster
    from drivecomm.bus.scanning import Asking, Found, Question, Search
    from drivecomm.line import Engine, LineQueue, PollItem
    from drivecomm.link import CommandCall, Health, HeldBack, Peer, Port, Statistics, Steps, TraceEvent
    from drivecomm.protocol import Model

T = TypeVar("T")
D = TypeVar("D")
E = TypeVar("E")

# An enumeration looks its members up by a function of Python's.
_STOP = Rank.STOP


class SharedBus(Generic[D, E]):
    """The master's side of one line. D: its drives. E: all drives of a protocol at once.

    open_port: opens the port, at once and again after it was lost. roster: the drives and what holds for all of them.
    on_close: called when the bus has been closed.
    """

    _drive: Callable[..., D]
    _broadcast: Callable[..., E]
    _opened_with: str
    queue: LineQueue
    """The callers of this line: who has it, and who waits."""

    def __init__(
        self, open_port: Callable[[], Port], roster: Roster, on_close: Callable[[], None] | None = None
    ) -> None:
        self._open_port = open_port
        self._roster = roster
        self._on_close = on_close
        self._first_listener = roster.link.trace
        self._listeners: tuple[Callable[[TraceEvent], None], ...] = ()
        self._closed = False
        self._reopening = Backoff(REOPEN_FIRST_S, REOPEN_LONGEST_S)
        self._failed_openings = 0
        self._port: Port | None = None
        self._clock: Port | None = None

    def drive(
        self,
        protocol: str,
        address: int,
        *,
        model: str | Path | Model | None = None,
        set_up: Mapping[str, Any] | None = None,
        read_only: bool = False,
        **options: Any,
    ) -> D:
        """Return the drive at an address; nothing is sent.

        model: a model of the protocol's package by name, or a TOML file. set_up: parameters and the values that are
        written to it, without storing them, before anything else is sent, and again whenever it or the line was away;
        such as its control watchdog. read_only: this drive can be asked and stopped; what writes or commands raises
        ReadOnlyError. options: line facts of this drive (baudrate, parity, reply_timeout_s, attempts, ...) and the
        protocol's own drive options. Raises UsageError for anything that cannot be.
        """
        member = self._roster.member(protocol, address, model, set_up, options, read_only=read_only)
        self._roster.add(member.peer.name, model, options)
        return self._drive(self, *member)

    def member(self, protocol: str, address: int, *, model: str | Path | Model | None = None, **options: Any) -> Member:
        """Return what a drive of this bus is made of, for who asks it in a way of its own; nothing is sent."""
        return self._roster.member(protocol, address, model, None, options)

    def broadcast(self, protocol: str, *, model: str | Path | Model | None = None, **options: Any) -> E:
        """Return all drives of a protocol at once; what is sent to them is never answered."""
        member = self._roster.all_drives(protocol, model, options)
        return self._broadcast(self, member.peer, member.operations)

    def command(self, peer: Peer, check: Callable[[], None] | None = None) -> CommandCall:
        """Take note that a drive, or all drives of a protocol, are to be commanded; a later stop cancels that."""
        return self._roster.commands.called(peer.name, check)

    def on_engine(self, engine: Engine) -> EngineLine | None:  # noqa: ARG002 - see `Bus`
        """Return this bus's line for an engine, which serves many in one thread.

        None where that cannot be: the port has no descriptor to watch, its time is not that of the world, or an event
        loop serves it.
        """
        return None

    def watched(self, peer: Peer, silence_s: float | None) -> None:
        """Take note how long a drive's watchdog waits; None when it is off, or not known."""
        self._roster.commands.watch(peer.name, silence_s)
        self._roster.link.repeat_within(peer, float("inf") if silence_s is None else silence_s)

    def listen(self, listener: Callable[[TraceEvent], None]) -> Callable[[], None]:
        """Have a listener told everything that happens on the line, beside those that are; returns what ends it."""
        self._listeners = (*self._listeners, listener)
        self._roster.link.trace = tell_all(self._first_listener, *self._listeners)

        def end() -> None:
            self._listeners = tuple(each for each in self._listeners if each is not listener)
            self._roster.link.trace = tell_all(self._first_listener, *self._listeners)

        return end

    def storing(self, peer: Peer, parameter: str) -> None:
        """Count a write that may end in EEPROM. Raises UsageError for one too many within an hour."""
        self._roster.stored_writes.count(peer.name, parameter, self.now())

    def kept_in_ram(self, peer: Peer, parameter: str) -> None:
        """Take note of a write that the drive forgets without power."""
        self._roster.stored_writes.kept_in_ram(peer.name, parameter)

    def in_ram_only(self, peer: Peer) -> frozenset[str]:
        """Return the parameters of a drive that were written through this bus and not stored since."""
        return self._roster.stored_writes.in_ram_only(peer.name)

    def now(self) -> float:
        """Return the time on the line's clock, in seconds; its beginning means nothing."""
        self._check_open()
        if self._clock is None:
            raise UsageError("this bus is not open; use it in `async with`")
        return self._clock.now()

    @property
    def real_time(self) -> bool:
        """Whether time passes by itself, as it does everywhere but on a virtual line."""
        return self._clock is None or self._clock.real_time

    def wall_time(self) -> float:
        """Return the time in seconds since 1970 (on a virtual line: since its start), also while the line is down.

        0 before the line was opened.
        """
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

    @property
    def other_master(self) -> str:
        """Why the line counts as shared with another master, empty if nobody else was heard on it lately.

        What whole, sound telegrams show that nobody here has sent or asked for: two within a minute. From then on, and
        until a minute has passed without any, readings whose replies do not name what was asked are uncertain.
        """
        return "" if self._clock is None else self._roster.link.other_master(self._clock.now())

    def _check_open(self) -> None:
        if self._closed:
            raise UsageError(f"this bus is closed; open it again with {self._opened_with}")

    def _called(self, job: Job[Any]) -> float:
        """Take note of a job that is called for, of which a stop cancels commands, and return when its time is over."""
        # Whether the bus is open is for those to say who find that it is not.
        now = self.now() if self._closed or self._clock is None else self._clock.now()
        deadline = now + job.peer.facts.timing.deadline_s
        if job.rank is _STOP:
            self._roster.commands.stop_called(job.peer.name)
        return deadline

    def _attempts(self, job: Job[T], queue: LineQueue) -> StopAttempts[T]:
        """Return the attempts of a stop that was called just now."""
        name = job.peer.name
        return StopAttempts(job, queue, self._roster.link.health, self._roster.commands.called(name))

    def _begin(self, job: Job[T], deadline: float, now: float, attempts: StopAttempts[T] | None = None) -> Steps[T]:
        """Return the steps that carry out a job on the link, beginning now. attempts: those of a stop."""
        link = self._roster.link
        if job.rank is _STOP:
            exchange = self._roster.stopping(job.peer, job.exchange)
            others_first = None if attempts is None else attempts.others_first
            return link.stop(job.peer, exchange, now, deadline=deadline, others_first=others_first)
        if job.insists:
            return link.insist(job.peer, job.exchange, now, deadline=deadline)
        return link.run(job.peer, job.exchange, now, deadline, job.command)

    def _put_off(self, job: Job[T], held: HeldBack) -> Job[T]:
        """Return the job that is carried out later, for one that was held back. Raises HeldBackError for a poll."""
        if job.rank is Rank.POLL:
            held.exchange.close()
            raise HeldBackError(
                f"{job.peer.name} was not asked: a late reply to an earlier question could be taken for its answer",
                held.until,
            ) from None
        return Job(job.peer, held.exchange, job.rank, job.command, job.insists)

    def _timed(self, result: T) -> T:
        """Return what a job has resulted in; a reading gets its time, and why it is in doubt."""
        if isinstance(result, Reading) and self._clock is not None:
            result.at(self._clock.wall_time())
        if doubt := self._roster.link.doubt:
            for each in result if isinstance(result, list) else (result,):
                if isinstance(each, Reading):
                    each.doubted(doubt)
        return result

    def _check_backoff(self, tried_before: int | None = None) -> None:
        """Raise LinkDownError as long as a port that was lost is not to be opened again.

        tried_before: for a stop, which does not wait for that unless the port has been tried in vain since it was
        called for: so the stops of many drives do not try it one after the other.
        """
        self._check_open()
        if self._clock is None or tried_before == self._failed_openings:
            return
        if (left_s := self._reopening.over_at - self._clock.now()) > 0:
            raise LinkDownError(f"the port was lost; it is opened again in {left_s:.1f} s")

    def _opening_failed(self) -> None:
        if self._clock is not None:
            self._failed_openings += 1
            self._reopening.failed(self._clock.now())

    def _was_opened(self, port: Port) -> None:
        self._reopening.succeeded()
        self._roster.link.paced = port.paced
        self._roster.proven.are_real = port.real_time
        self._roster.link.opened(port.now())
        if self._clock is not None:
            self._roster.link.reopened()
        self._port = self._clock = port

    def questions(
        self, search: Search, progress: Callable[[str, int, int], None] | None, options: Mapping[str, Any]
    ) -> Iterator[Question | Found]:
        """Yield the questions of a scan, whose answers must be filled in, and the drives that were found by them."""

        def member(asking: Asking) -> Member:
            return self._roster.member(asking.protocol, asking.address, None, None, {**asking.options, **options})

        from drivecomm.bus.scanning import scanning

        return scanning(search, member, progress)

    def _on_this_bus(self, items: Iterable[PollItem[Any]], elsewhere: str) -> list[PollItem[Any]]:
        """Return the items of a poll plan. Raises UsageError for a drive on another bus."""
        plan = list(items)
        for item in plan:
            if item.drive.bus is not self:
                raise UsageError(f"{item.drive.name} is not on this bus; poll it with {elsewhere}")
        return plan
