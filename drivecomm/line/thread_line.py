"""Line for threads: each waits for its turn, and then carries out its job itself."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, TypeVar

from drivecomm.errors import LinkDownError, PortError, ReplyError
from drivecomm.line.owner import LineOwner
from drivecomm.line.queue import Rank, line_was_busy
from drivecomm.line.thread_host import run_steps
from drivecomm.line.thread_turns import ThreadTurn, ThreadTurns
from drivecomm.link import HeldBack

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.line.engine_line import EngineLine
    from drivecomm.line.job import Job
    from drivecomm.line.line_engine import Engine
    from drivecomm.line.stopping import StopAttempts
    from drivecomm.link import Port

T = TypeVar("T")


class ThreadLine(LineOwner):
    """One line among threads; the arguments are those of `LineOwner`. It is opened before it is used.

    turns: hands the line from thread to thread.
    """

    clock: Port
    turns: ThreadTurns

    _opened_with = "open_bus"
    _new_turns = ThreadTurns

    def run(self, job: Job[T]) -> T:
        """Carry out a job when its turn comes; a lost port is opened again first.

        Raises the errors of the exchange, DeadlineError when the drive's deadline_s passes, CommandCancelledError for a
        command that a stop has cancelled, NotAnsweringError for a drive that is known to be silent.
        """
        deadline = self.called(job)
        while job.rank is not Rank.STOP:
            try:
                return self._run(job, deadline, ThreadTurn(job.rank))
            except HeldBack as held:
                job = self.put_off(job, held)
                self.sleep_until(held.until)
        attempts, tried_before = self.attempts(job), self.failed_openings
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
        """Carry out a job in one turn. tried_before: see `check_backoff`."""
        peer = job.peer
        try:
            with turn.held:
                if not self.turns.ask(turn):
                    self._wait_for(turn, peer.facts.timing.deadline_s, peer.name)
                port = self.port or self.opened(tried_before)
                try:
                    steps = self.begin(job, deadline, port.now(), attempts)
                    return self.with_time(run_steps(steps, port, self.turns.stop_waits))
                except LinkDownError:
                    self.let_go()
                    raise
        finally:
            self.turns.hand_on()

    def opened(self, tried_before: int | None = None) -> Port:
        """Open the port, for the first time or after a loss; may block. tried_before: see `check_backoff`."""
        self.check_backoff(tried_before)
        try:
            port = self.open_port()
        except (PortError, LinkDownError):
            self.opening_failed()
            raise
        self.was_opened(port)
        return port

    def on_engine(self, engine: Engine) -> EngineLine | None:
        """Return this line for an engine; None if its port cannot be watched, or its clock is virtual."""
        if not self.clock.real_time or self.clock.descriptor is None:
            return None
        from drivecomm.line.engine_line import EngineLine

        return EngineLine(self, engine)

    def sleep_until(self, until: float) -> None:
        """Wait until this time on the line's clock; others may use the line meanwhile."""
        if self.clock.real_time:
            while (left := until - self.clock.now()) > 0:
                time.sleep(left)
            return
        self._alone(Rank.POLL, lambda: self.clock.wait(until))

    def lend(self, work: Callable[[Port, Port], T]) -> T:
        """Lend the port, newly opened, to a function; return the function's result.

        work: gets the port, and a proxy of this port that raises LinkDownError as soon as a stop waits for the line.
        Raises PortError if the port cannot be opened.
        """
        from drivecomm.line.lent_port import LentPort

        def carry_out() -> T:
            self.let_go()
            port = self.open_port()
            try:
                return work(port, LentPort(port, self.check_no_stop_waits))
            finally:
                port.close()

        return self._alone(Rank.COMMAND, carry_out)

    def close(self) -> None:
        """Close the port for good; the line cannot be used any more."""
        self._alone(Rank.COMMAND, self.shut)

    def _alone(self, rank: Rank, work: Callable[[], T]) -> T:
        """Call a function while no other caller has the line."""
        turn = ThreadTurn(rank)
        try:
            with turn.held:
                if not self.turns.ask(turn):
                    self._wait_for(turn, float("inf"), "the bus")
                return work()
        finally:
            self.turns.hand_on()

    def _wait_for(self, turn: ThreadTurn, seconds: float, who: str) -> None:
        if not self.turns.wait(turn, seconds):
            raise line_was_busy(who, seconds)
