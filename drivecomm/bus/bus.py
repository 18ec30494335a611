"""One line and its drives, from the master's side."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any, Self, TypeVar

from drivecomm.bus.drive import Broadcast, Drive
from drivecomm.bus.roster import Roster, echo_mode, line_overrides
from drivecomm.bus.scanning import Found, Search, introduce, look
from drivecomm.bus.stored_writes import ALLOWED, StoredWrites
from drivecomm.bus.turns import Rank, Turn, Turns
from drivecomm.errors import DeadlineError, LinkDownError, PortError, UsageError, shortened
from drivecomm.link import GrowingPause
from drivecomm.polling import poll
from drivecomm.transport import run

if TYPE_CHECKING:
    from collections import Counter
    from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
    from pathlib import Path
    from types import TracebackType

    from drivecomm.bus.likely_settings import LineChoices
    from drivecomm.capture import Record
    from drivecomm.link import CommandCall, Echo, Health, Party, Port, Statistics, Steps, TraceEvent
    from drivecomm.polling import PollItem, PollResult
    from drivecomm.protocol import Exchange, Model, Parity, Reading

T = TypeVar("T")
R = TypeVar("R", "Reading", "Reading | None")

_CLOSED = "this bus is closed; open it again with open_bus"

REOPEN_FIRST_S = 0.5
REOPEN_LONGEST_S = 2.0


class Bus:
    """The master's side of one line. Runs one exchange at a time, whoever asks; may be used from many threads.

    open_port: opens the port, at once and again after it was lost. roster: the drives and what holds for all of them.
    on_close: called when the bus has been closed.
    """

    def __init__(
        self, open_port: Callable[[], Port], roster: Roster, on_close: Callable[[], None] | None = None
    ) -> None:
        self._open_port = open_port
        self._roster = roster
        self._on_close = on_close
        self._turns = Turns()
        self._closed = False
        self._reopening = GrowingPause(REOPEN_FIRST_S, REOPEN_LONGEST_S)
        self._port: Port | None = open_port()
        self._clock: Port = self._port
        roster.link.paced = self._port.paced
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
    ) -> Drive:
        """Return the drive at an address; nothing is sent.

        model: a model of the protocol's package by name, or a TOML file. set_up: parameters and the values that are
        written to it, without storing them, before anything else is sent, and again whenever it or the line was away;
        such as its control watchdog. read_only: why this drive may not be written or commanded, as the sentence of the
        UsageError that is raised then; it can be asked, and stopped. options: line facts of this drive (baudrate,
        parity, reply_timeout_s, attempts, ...) and the protocol's own drive options. Raises UsageError for anything
        that cannot be.
        """
        member = self._roster.member(protocol, address, model, set_up, options, read_only=read_only)
        self._roster.add(member.party.name)
        return Drive(self, *member)

    def broadcast(self, protocol: str, *, model: str | Path | Model | None = None, **options: Any) -> Broadcast:
        """Return all drives of a protocol at once; what is sent to them is never answered."""
        member = self._roster.all_drives(protocol, model, options)
        return Broadcast(self, member.party, member.operations)

    def scan(
        self,
        only: Iterable[str] | None = None,
        addresses: Iterable[int] | None = None,
        *,
        choices: LineChoices | None = None,
        progress: Callable[[str, int, int], None] | None = None,
        **options: Any,
    ) -> Iterator[Found]:
        """Yield the drives that answer; sends only what cannot move a motor.

        Without choices it goes protocol by protocol, at the settings that each one has on this bus. With them it is a
        wide scan, which tries other line settings, too, the likely ones of all protocols first; `LineChoices()` is all
        that are likely. Whether somebody is there is asked once. Give `Bus.drive` the options of what was found.

        only: protocol names, all installed ones if absent. addresses: those to ask, the protocol's usual ones if
        absent; addresses that a protocol does not have are left out. progress: told what is asked, how many questions
        are done, and how many there are. options: line facts for all drives asked.
        """
        search = Search(only, addresses, choices)
        asking = None
        for asking in search:
            if progress is not None:
                progress(str(asking), search.done, search.total)
            member = self._roster.member(asking.protocol, asking.address, None, None, {**asking.options, **options})
            seen = self.insist(member.party, look(asking, member.operations, member.party.facts.settings))
            found = search.heard(asking, seen)
            if found is not None and found.sound:
                found = search.model_of(self.insist(member.party, introduce(found, member.operations)))
            if found is not None:
                yield found
        yield from search.damaged()
        if progress is not None and asking is not None:
            progress(str(asking), search.total, search.total)

    def poll(
        self, items: Iterable[PollItem[Drive]], *, duration_s: float | None = None, cycles: int | None = None
    ) -> Generator[PollResult, None, None]:
        """Yield the results of a poll plan for drives on this bus; see `drivecomm.poll`."""
        plan = list(items)
        for item in plan:
            if item.drive.bus is not self:
                raise UsageError(f"{item.drive.name} is not on this bus; poll it with drivecomm.poll")
        return poll(plan, duration_s=duration_s, cycles=cycles)

    def run(self, party: Party, exchange: Exchange[T], rank: Rank = Rank.READ, command: CommandCall | None = None) -> T:
        """Carry out an exchange with a drive, unless the drive is known not to answer; waits for its turn.

        A port that was lost is opened again first. Raises DeadlineError when the drive's deadline_s passes, and
        CommandCancelledError for a command that a stop has cancelled.
        """
        deadline = self.now() + party.facts.timing.deadline_s
        return self._in_turn(self._roster.link.run(party, exchange, deadline=deadline, command=command), party, rank)[0]

    def reading(
        self, party: Party, exchange: Exchange[R], rank: Rank = Rank.READ, command: CommandCall | None = None
    ) -> R:
        """Carry out an exchange as `run` does; the reading that it results in gets the time of its reply."""
        deadline = self.now() + party.facts.timing.deadline_s
        steps = self._roster.link.run(party, exchange, deadline=deadline, command=command)
        result, time_s = self._in_turn(steps, party, rank)
        return result and result.at(time_s)

    def insist(self, party: Party, exchange: Exchange[T]) -> T:
        """Carry out an exchange whatever is known of the drive; waits for its turn."""
        deadline = self.now() + party.facts.timing.deadline_s
        return self._in_turn(self._roster.link.insist(party, exchange, deadline=deadline), party, Rank.READ)[0]

    def stop(self, party: Party, exchange: Exchange[T]) -> T:
        """Carry out an exchange that stops a motor, or all of a protocol; see `drivecomm.link.command_order`."""
        deadline = self.now() + party.facts.timing.deadline_s
        self._roster.commands.stop_called(party.name)
        stopping = self._roster.stopping(party, exchange)
        return self._in_turn(self._roster.link.stop(party, stopping, deadline=deadline), party, Rank.STOP)[0]

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
        return self._clock.now()

    @property
    def real_time(self) -> bool:
        """Whether time passes by itself, as it does everywhere but on a virtual line."""
        return self._clock.real_time

    def sleep_until(self, until: float) -> None:
        """Let time pass on the line's clock; others may use the line meanwhile."""
        if self._clock.real_time:
            while (left := until - self._clock.now()) > 0:
                time.sleep(left)
            return
        turn = Turn(Rank.POLL)
        try:
            with turn.held:
                self._wait_for(turn, float("inf"), "the bus")
                self._clock.wait(until)
        finally:
            self._turns.hand_on()

    def wall_time(self) -> float:
        """Return the time in seconds since 1970 (on a virtual line: since its start), also while the line is down."""
        return self._clock.wall_time()

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

    def close(self) -> None:
        """Give the port back; the bus cannot be used any more."""
        turn = Turn(Rank.COMMAND)
        try:
            with turn.held:
                self._wait_for(turn, float("inf"), "the bus")
                self._closed = True
                if self._port is not None:
                    self._port.close()
                    self._port = None
                if self._on_close is not None:
                    self._on_close()
        finally:
            self._turns.hand_on()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def _in_turn(self, steps: Steps[T], party: Party, rank: Rank) -> tuple[T, float]:
        turn = Turn(rank)
        try:
            with turn.held:
                self._wait_for(turn, party.facts.timing.deadline_s, party.name)
                port = self._opened()
                try:
                    result = run(steps, port, self._turns.stop_waits)
                except LinkDownError:
                    self._port = None
                    port.close()
                    raise
                return result, port.wall_time()
        finally:
            self._turns.hand_on()

    def _wait_for(self, turn: Turn, seconds: float, who: str) -> None:
        if self._turns.is_mine():
            raise UsageError("a trace function cannot use the bus that calls it")
        if not self._turns.take(turn, seconds):
            raise DeadlineError(f"{who}: the line was busy with others for {seconds:g} s")

    def _opened(self) -> Port:
        if self._port is not None:
            return self._port
        if self._closed:
            raise UsageError(_CLOSED)
        now = self._clock.now()
        if now < self._reopening.over_at:
            raise LinkDownError(f"the port was lost; it is opened again in {self._reopening.over_at - now:.1f} s")
        try:
            self._port = self._clock = self._open_port()
        except (PortError, LinkDownError):
            self._reopening.failed(now)
            raise
        self._reopening.succeeded()
        self._roster.link.paced = self._port.paced
        self._roster.link.reopened()
        return self._port


def open_bus(
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
) -> Bus:
    """Open a line and return its bus, a context manager.

    port: what pyserial opens ("/dev/ttyUSB0", "COM3", "socket://host:4001", "rfc2217://host:4001", "loop://"), or a
    function that returns a port, such as `VirtualLine.port`. baudrate, bytesize, parity, stopbits, reply_timeout_s,
    attempts: for all drives, instead of their protocols' defaults. echo: whether the adapter hands back what it sends:
    "off", "expect" (also True), or "auto" to see by itself. guard_s: quiet time after a change of line settings. rs485:
    let the driver of the port switch the transmitter. low_latency: whether a USB adapter shall hand bytes over at once;
    None does so where it can be set. trace: called for everything that happens on the line. record: a file that gets
    every byte sent and received, .jsonl or .pcapng, or an object with `add(piece)`. stored_writes_per_hour: how often
    one parameter of a drive may be written to EEPROM. facts: further timing for all drives, by the names of `Timing`,
    such as gap_s or turnaround_s.

    Raises PortError when the port does not exist, is in use, or has not what was asked for, UsageError for a name that
    is no line fact.
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
        return Bus(opener, roster)
    # Files and their formats are for those who record.
    from drivecomm.capture import Recording  # noqa: PLC0415

    name = port if isinstance(port, str) else ""
    recording = Recording(opener, record, name=name, echo=echo_mode(echo), drives=roster.names)
    return Bus(recording.open_port, roster, recording.close)


def port_opener(
    port: str | Callable[[], Port], *, rs485: bool = False, low_latency: bool | None = None
) -> Callable[[], Port]:
    """Return what opens this port, and opens it again when it was lost: then by the name that follows the adapter."""
    if not isinstance(port, str):
        if not callable(port):
            raise UsageError(f"{shortened(port)} is no port; give its name, or a function that returns one")
        return port
    names = [port]

    def open_port() -> Port:
        # pyserial is loaded by those who open a port, not by those who import drivecomm.
        from drivecomm.transport import SerialPort  # noqa: PLC0415

        opened = SerialPort(names[0], rs485=rs485, low_latency=low_latency)
        names[0] = opened.stable_name
        return opened

    return open_port
