"""Common part of `Bus` and `AsyncBus`: the drives of a line, its clock, and the records about the line."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Generic, TypeVar

from drivecomm.bus.discoverable import Discoverable
from drivecomm.errors import UsageError, counted
from drivecomm.link import combine_traces

if TYPE_CHECKING:
    from collections import Counter
    from collections.abc import Callable, Iterable, Iterator, Mapping
    from pathlib import Path

    from drivecomm.bus.line_drives import DriveParts, LineDrives
    from drivecomm.bus.scanning import Found, ScanProbe, ScanRequest, Search
    from drivecomm.line import Engine, EngineLine, LineOwner, PollItem
    from drivecomm.link import CommandCall, Health, Peer, Port, Statistics, TraceEvent
    from drivecomm.protocol import MachineUnit, Model

D = TypeVar("D")
E = TypeVar("E")


class SharedBus(Discoverable, Generic[D, E]):
    """The master's side of one line. D: type of its drives. E: type of its broadcasts.

    line: its port, its queue, and the execution of jobs. roster: the drives and the settings that all of them share.
    """

    _inner = frozenset(
        {
            "command",
            "in_ram_only",
            "kept_in_ram",
            "lend",
            "line",
            "member",
            "on_engine",
            "questions",
            "run",
            "storing",
            "wall_time",
            "watched",
        }
    )
    _drive: Callable[..., D]
    _broadcast: Callable[..., E]
    line: LineOwner

    def __init__(self, roster: LineDrives) -> None:
        self._roster = roster
        self._first_listener = roster.link.trace
        self._listeners: tuple[Callable[[TraceEvent], None], ...] = ()

    def __repr__(self) -> str:
        drives = counted(len(self._roster.names()), "drive")
        return f"<{type(self).__name__} {self._roster.port or 'on a port object'}, {drives}, {self.line.condition}>"

    def _was_opened(self, port: Port) -> None:
        self._roster.proven.are_real = port.real_time

    def drive(
        self,
        protocol: str,
        address: int,
        *,
        model: str | Path | Model | None = None,
        set_up: Mapping[str, Any] | None = None,
        read_only: bool = False,
        machine: MachineUnit | None = None,
        **options: Any,
    ) -> D:
        """Return the drive at an address; nothing is sent.

        model: a model of the protocol's package by name, or a TOML file. set_up: parameters and values, such as a
        control watchdog, that are written to the drive without storing them: before anything else is sent, and again
        whenever the drive or the line was away. read_only: whether the drive can only be read and stopped; writes and
        commands then raise ReadOnlyError. machine: the unit in which its machine counts its speed. options: line facts
        of this drive (baudrate, parity, reply_timeout_s, attempts, ...) and the protocol's own drive options. Raises
        UsageError for invalid arguments.
        """
        member = self._roster.member(protocol, address, model, set_up, options, read_only=read_only)
        self._roster.add(member.peer.name, model, options)
        return self._drive(self, *member, machine)

    def member(
        self, protocol: str, address: int, *, model: str | Path | Model | None = None, **options: Any
    ) -> DriveParts:
        """Return the parts of a drive of this bus, for callers that make their own requests; nothing is sent."""
        return self._roster.member(protocol, address, model, None, options)

    def broadcast(self, protocol: str, *, model: str | Path | Model | None = None, **options: Any) -> E:
        """Return an object that broadcasts to all drives of a protocol; broadcasts are never answered."""
        member = self._roster.all_drives(protocol, model, options)
        return self._broadcast(self, member.peer, member.operations)

    def command(self, peer: Peer, check: Callable[[], None] | None = None) -> CommandCall:
        """Register a command for a drive, or for all drives of a protocol; a later stop cancels it."""
        return self._roster.commands.called(peer.name, check)

    def on_engine(self, engine: Engine) -> EngineLine | None:  # noqa: ARG002 - see `Bus`
        """Return this bus's line for an engine, which serves many lines in one thread.

        None if the port has no descriptor to watch, its clock is virtual, or an event loop serves it.
        """
        return None

    def watched(self, peer: Peer, silence_s: float | None) -> None:
        """Record how many seconds a drive's watchdog waits; None if the watchdog is off, or unknown."""
        self._roster.commands.watch(peer.name, silence_s)
        self._roster.link.repeat_within(peer, float("inf") if silence_s is None else silence_s)

    def listen(self, listener: Callable[[TraceEvent], None]) -> Callable[[], None]:
        """Report every event of the line to one more listener; return a function that removes it."""
        self._listeners = (*self._listeners, listener)
        self._roster.link.trace = combine_traces(self._first_listener, *self._listeners)

        def end() -> None:
            self._listeners = tuple(each for each in self._listeners if each is not listener)
            self._roster.link.trace = combine_traces(self._first_listener, *self._listeners)

        return end

    def storing(self, peer: Peer, parameter: str) -> None:
        """Count a write that may go to EEPROM. Raises UsageError if there are too many within an hour."""
        self._roster.stored_writes.count(peer.name, parameter, self.now())

    def kept_in_ram(self, peer: Peer, parameter: str) -> None:
        """Record a write that the drive loses without power."""
        self._roster.stored_writes.kept_in_ram(peer.name, parameter)

    def in_ram_only(self, peer: Peer) -> frozenset[str]:
        """Return the parameters of a drive that were written through this bus and not stored since."""
        return self._roster.stored_writes.in_ram_only(peer.name)

    def now(self) -> float:
        """Return the time on the line's clock, in seconds from an arbitrary zero."""
        return self.line.now()

    @property
    def real_time(self) -> bool:
        """Whether time passes by itself, as on every line except a virtual one."""
        return self.line.real_time

    def wall_time(self) -> float:
        """Return the time in seconds since 1970 (on a virtual line: since its start), even while the line is down.

        The result is 0 before the line was opened.
        """
        return 0.0 if self.line.clock is None else self.line.clock.wall_time()

    @property
    def counters(self) -> Mapping[str, Counter[str]]:
        """Counters so far, by drive: requests, replies, retries, timeouts, and each kind of error."""
        return self._roster.link.counters

    @property
    def statistics(self) -> Mapping[str, Statistics]:
        """The counters and the reply times, by drive."""
        return self._roster.link.statistics

    @property
    def health(self) -> Mapping[str, Health]:
        """Health of the drives, by name."""
        return self._roster.link.health

    @property
    def other_master(self) -> str:
        """Why the line counts as shared with another master; empty if none was heard lately.

        The evidence is two whole, sound telegrams within a minute that were neither sent nor requested by this program.
        From then on, until a minute has passed without any, readings whose replies do not name their request are
        uncertain.
        """
        return "" if self.line.clock is None else self._roster.link.other_master(self.line.clock.now())

    def questions(
        self, search: Search, progress: Callable[[str, int, int], None] | None, options: Mapping[str, Any]
    ) -> Iterator[ScanRequest | Found]:
        """Yield the requests of a scan, whose results the caller must fill in, and the drives that they find."""

        def member(asking: ScanProbe) -> DriveParts:
            return self._roster.member(asking.protocol, asking.address, None, None, {**asking.options, **options})

        from drivecomm.bus.scanning import scanning

        search.leave_out(self._roster.is_foreign)
        return scanning(search, member, progress)

    def _on_this_bus(self, items: Iterable[PollItem[Any]], elsewhere: str) -> list[PollItem[Any]]:
        """Return the items of a poll plan. Raises UsageError for a drive on another bus."""
        plan = list(items)
        for item in plan:
            if item.drive.bus is not self:
                raise UsageError(f"{item.drive.name} is not on this bus; poll it with {elsewhere}")
        return plan
