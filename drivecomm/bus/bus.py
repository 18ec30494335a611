"""One line and its drives, from the master's side."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any, Self, TypeVar, Unpack

from drivecomm.bus.drives import Broadcast, Drive
from drivecomm.bus.opening import opened_with
from drivecomm.bus.procedures import carry_out
from drivecomm.bus.shared_bus import SharedBus
from drivecomm.errors import LinkDownError, OvertakenError, PortError, ReplyError
from drivecomm.line import Rank, ThreadTurn, ThreadTurns, line_was_busy, run_steps
from drivecomm.link import HeldBack
from drivecomm.protocol import Stop

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterable, Iterator

    from drivecomm.bus.engine_line import EngineLine
    from drivecomm.bus.likely_settings import LineChoices
    from drivecomm.bus.opening import LineOptions
    from drivecomm.bus.roster import Roster
    from drivecomm.bus.scanning import Found, Question
    from drivecomm.bus.stopping_all import OnResult, StopResult
    from drivecomm.line import Engine, Job, PollItem, PollResult, StopAttempts
    from drivecomm.link import Port
    from drivecomm.protocol import DriveConfig

T = TypeVar("T")


class Bus(SharedBus[Drive, Broadcast]):
    """The master's side of one line. Runs one exchange at a time, whoever asks; may be used from many threads.

    open_port: opens the port, at once and again after it was lost. roster: the drives and what holds for all of them.
    on_close: called when the bus has been closed.
    """

    _drive = Drive
    _broadcast = Broadcast
    _opened_with = "open_bus"
    _clock: Port

    def __init__(
        self, open_port: Callable[[], Port], roster: Roster, on_close: Callable[[], None] | None = None
    ) -> None:
        super().__init__(open_port, roster, on_close)
        self._turns = ThreadTurns()
        self.queue = self._turns.queue
        roster.link.stop_waits = self._turns.stop_waits
        self._was_opened(open_port())

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
        from drivecomm.bus.scanning import Found, Search

        search = Search(only, addresses, choices)
        for each in self.questions(search, progress, options):
            if isinstance(each, Found):
                yield search.model_of(each)
            else:
                each.found = self._asked(each)

    def _asked(self, question: Question) -> Found | None:
        """Ask until no stop goes first."""
        while True:
            try:
                return self.run(question.job)
            except OvertakenError:
                continue

    def poll(
        self, items: Iterable[PollItem[Drive]], *, duration_s: float | None = None, cycles: int | None = None
    ) -> Generator[PollResult, None, None]:
        """Yield the results of a poll plan for drives on this bus; see `drivecomm.poll`."""
        from drivecomm.line import poll

        return poll(self._on_this_bus(items, "drivecomm.poll"), duration_s=duration_s, cycles=cycles)

    def stop_all(
        self,
        how: Stop = Stop.RAMP,
        *,
        drives: Iterable[DriveConfig] | None = None,
        on_result: OnResult | None = None,
    ) -> list[StopResult]:
        """Stop all motors of this line, and return what came of each stop; nothing is raised for a drive or the line.

        By broadcasts first, which nobody confirms, then each drive by itself; those that are silent last. drives: those
        of this line, as a plant file has them; those that were made with `drive` if absent. on_result: called with each
        outcome as it comes.
        """
        from drivecomm.bus.stopping_all import stopping_all

        return carry_out(None, stopping_all(self, self._roster.drives if drives is None else drives, how, on_result))

    def run(self, job: Job[T]) -> T:
        """Carry out a job when it is its turn; a port that was lost is opened again first.

        Raises what the exchange raises, DeadlineError when the drive's deadline_s passes, CommandCancelledError for a
        command that a stop has cancelled, NotAnsweringError for a drive that is known not to answer.
        """
        deadline = self._called(job)
        while job.rank is not Rank.STOP:
            try:
                return self._run(job, deadline, ThreadTurn(job.rank))
            except HeldBack as held:
                job = self._put_off(job, held)
                self.sleep_until(held.until)
        attempts, tried_before = self._attempts(job, self._turns.queue), self._failed_openings
        while True:
            turn = ThreadTurn(attempts.rank, behind=attempts.behind)
            try:
                return self._run(attempts.job, deadline, turn, attempts, tried_before)
            except ReplyError as error:
                attempts.after(error)

    def _run(
        self,
        job: Job[T],
        deadline: float,
        turn: ThreadTurn,
        attempts: StopAttempts[T] | None = None,
        tried_before: int | None = None,
    ) -> T:
        """Carry out a job in one turn. tried_before: see `_check_backoff`."""
        peer = job.peer
        try:
            with turn.held:
                if not self._turns.ask(turn):
                    self._wait_for(turn, peer.facts.timing.deadline_s, peer.name)
                port = self._port or self._opened(tried_before)
                try:
                    steps = self._begin(job, deadline, port.now(), attempts)
                    return self._timed(run_steps(steps, port, self._turns.stop_waits))
                except LinkDownError:
                    self._lost(port)
                    raise
        finally:
            self._turns.hand_on()

    def on_engine(self, engine: Engine) -> EngineLine | None:
        """Return this bus's line for an engine, which serves many in one thread; None where that cannot be."""
        if not self.real_time or self._clock.descriptor is None:
            return None
        from drivecomm.bus.engine_line import BusParts, EngineLine

        parts = BusParts(
            turns=self._turns,
            called=self._called,
            attempts=self._attempts,
            begin=self._begin,
            put_off=self._put_off,
            timed=self._timed,
            port=lambda: self._port,
            opened=self._opened,
            lost=self._lost,
        )
        return EngineLine(parts, engine)

    def sleep_until(self, until: float) -> None:
        """Let time pass on the line's clock; others may use the line meanwhile."""
        if self._clock.real_time:
            while (left := until - self._clock.now()) > 0:
                time.sleep(left)
            return
        self._alone(Rank.POLL, lambda: self._clock.wait(until))

    def lend(self, work: Callable[[Port, Port], T]) -> T:
        """Let a function have the port for itself, opened anew for it; return what it returns.

        work: is given the port, and the same port as one that fails with LinkDownError as soon as a stop waits for the
        line. Raises PortError when it cannot be opened.
        """
        from drivecomm.bus.lending import LentPort

        def carry_out() -> T:
            if self._port is not None:
                self._lost(self._port)
            port = self._open_port()
            try:
                return work(port, LentPort(port, self._turns.stop_waits))
            finally:
                port.close()

        return self._alone(Rank.COMMAND, carry_out)

    def close(self) -> None:
        """Give the port back; the bus cannot be used any more."""

        def carry_out() -> None:
            self._closed = True
            if self._port is not None:
                self._port.close()
                self._port = None
            if self._on_close is not None:
                self._on_close()

        self._alone(Rank.COMMAND, carry_out)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _alone(self, rank: Rank, work: Callable[[], T]) -> T:
        """Call a function while nobody else has the line."""
        turn = ThreadTurn(rank)
        try:
            with turn.held:
                if not self._turns.ask(turn):
                    self._wait_for(turn, float("inf"), "the bus")
                return work()
        finally:
            self._turns.hand_on()

    def _wait_for(self, turn: ThreadTurn, seconds: float, who: str) -> None:
        if not self._turns.wait(turn, seconds):
            raise line_was_busy(who, seconds)

    def _lost(self, port: Port) -> None:
        self._port = None
        port.close()

    def _opened(self, tried_before: int | None = None) -> Port:
        self._check_backoff(tried_before)
        try:
            port = self._open_port()
        except (PortError, LinkDownError):
            self._opening_failed()
            raise
        self._was_opened(port)
        return port


def open_bus(port: str | Callable[[], Port], **options: Unpack[LineOptions]) -> Bus:
    """Open a line and return its bus, a context manager.

    port: what pyserial opens ("/dev/ttyUSB0", "COM3", "socket://host:4001", "rfc2217://host:4001", "loop://"), or a
    function that returns a port, such as `VirtualLine.port`. options: those of `LineOptions`.

    Raises PortError when the port does not exist, is in use, or has not what was asked for, UsageError for a name that
    is no line fact.
    """
    return Bus(*opened_with(port, options))
