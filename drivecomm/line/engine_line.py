"""A line served by a thread together with others; it carries out jobs like `ThreadLine.run`, but never blocks."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.errors import DriveCommError, LinkDownError, ReplyError
from drivecomm.line.queue import Rank, line_was_busy
from drivecomm.line.runner import LineRunner
from drivecomm.line.thread_turns import LOOK_S, ThreadTurn
from drivecomm.link import HeldBack

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.line.job import Job
    from drivecomm.line.line_engine import Engine
    from drivecomm.line.stopping import StopAttempts
    from drivecomm.line.thread_line import ThreadLine
    from drivecomm.link import Port


class EngineLine:
    """One line on an engine, with one job at a time. Between two jobs, other threads may use the line, by rank."""

    def __init__(self, line: ThreadLine, engine: Engine) -> None:
        self._line = line
        self._turns, self._stop_waits = line.turns, line.turns.stop_waits
        self._engine = engine
        self._now = engine.now
        self._turn: _EngineTurn | None = None
        self._has_turn = False
        self._port: Port | None = None
        self._runner: LineRunner | None = None
        self._watched: int | None = None
        self._woken_at = float("inf")
        self._job: Job[Any] | None = None
        self._attempts: StopAttempts[Any] | None = None
        self._tried_before: int | None = None
        """See `LineOwner.check_backoff`."""
        self._deadline = 0.0
        self._ended: Callable[[Any, Exception | None], None] = _nobody

    def run(self, job: Job[Any], ended: Callable[[Any, Exception | None], None]) -> None:
        """Carry out a job when the line's turn comes.

        ended: called with the job's result or error, maybe before `run` returns. The line keeps its turn after the job
        if no other caller waits, so that the next job can follow immediately. `rest` gives the turn back.
        """
        self._job, self._ended = job, ended
        try:
            self._deadline = deadline = self._line.called(job)
        except Exception as error:  # noqa: BLE001 - passed on to the caller of the job
            self._end(None, error)
            return
        self._attempts = self._tried_before = None
        if job.rank is Rank.STOP:
            self._attempts, self._tried_before = self._line.attempts(job), self._line.failed_openings
            if self._has_turn or self._ask(job.rank, behind=self._attempts.behind):
                self._begin()
        elif self._has_turn and self._runner is not None:
            # While the line keeps its turn, no other thread can have opened or lost the port.
            self._runner.begin(self._line.begin(job, deadline, self._now(), None), self._stop_waits)
        elif self._has_turn or self._ask(job.rank):
            self._begin()

    def rest(self) -> None:
        """Give back the turn, if this line has it."""
        turn, self._turn = self._turn, None
        if turn is None:
            return
        self._has_turn = False
        self._unwatch()
        turn.held.release()
        self._turns.hand_on()

    def close(self) -> None:
        """Abort the current job and give back the turn."""
        if self._runner is not None:
            self._runner.cut_off()
        self._job = None
        self.rest()

    def _ask(self, rank: Rank, *, behind: bool = False) -> bool:
        """Request a turn. Returns True if it has come immediately; otherwise the engine calls back later."""
        turn = self._turn = _EngineTurn(rank, self._engine, self._called_back, self._give_way, behind=behind)
        turn.held.acquire()
        self._has_turn = self._turns.ask(turn)
        if not self._has_turn:
            self._engine.call_at(self._now() + LOOK_S, self._called_back)
        return self._has_turn

    def _called_back(self) -> None:
        """Begin the job if the turn has come; end it with an error if its deadline has passed."""
        turn, job = self._turn, self._job
        if turn is None or self._has_turn or job is None:
            return
        if not self._turns.has_come(turn):
            if (now := self._now()) < self._deadline:
                # An interrupted thread may have ended its turn without waking another, so every waiting line polls.
                self._engine.call_at(min(now + LOOK_S, self._deadline), self._called_back)
                return
            if self._turns.leave(turn):
                self._turn = None
                turn.held.release()
                self._turns.hand_on()
                self._end(None, line_was_busy(job.peer.name, job.peer.facts.timing.deadline_s))
                return
        self._has_turn = True
        self._begin()

    def _give_way(self) -> None:
        if self._runner is not None:
            self._runner.give_way()

    def _begin(self) -> None:
        """Carry out the job, now that the turn has come."""
        port, job = self._line.port, self._job
        if port is None:
            self._engine.aside(self._open)
        elif job is not None:
            if port is not self._port:
                self._port, self._woken_at = port, float("inf")
                self._runner = LineRunner(port, self._wake_at, self._wake_precisely, self._end, self._lose_port)
            runner = self._runner
            if runner is not None and port.descriptor is not None:
                if self._watched is None:
                    self._engine.watch(port.descriptor, runner.readable)
                    self._watched = port.descriptor
                runner.turn_came()
                runner.begin(self._line.begin(job, self._deadline, self._now(), self._attempts), self._stop_waits)

    def _open(self) -> None:
        """Open the port again, in a separate thread."""
        try:
            self._line.opened(self._tried_before)
        except Exception as error:  # noqa: BLE001 - passed on to the caller of the job
            failed = error
            self._engine.call_soon(lambda: self._end(None, failed))
        else:
            self._engine.call_soon(self._begin)

    def _wake_at(self, until: float) -> None:
        # Keep an earlier timer, and set it anew when it fires: most replies come long before it.
        if until < self._woken_at:
            self._woken_at = until
            self._engine.call_at(until, self._timed)

    def _timed(self) -> None:
        self._woken_at = float("inf")
        if self._runner is not None:
            self._runner.time_passed()

    def _wake_precisely(self, until: float) -> None:
        self._engine.call_at(until, self._paused)

    def _paused(self) -> None:
        if self._runner is not None:
            self._runner.time_passed()

    def _lose_port(self, _error: LinkDownError) -> None:
        # A closed descriptor cannot be watched.
        self._unwatch()
        if self._port is not None and self._port is self._line.port:
            self._line.let_go()
        self._port = self._runner = None

    def _unwatch(self) -> None:
        if self._watched is not None:
            self._engine.unwatch(self._watched)
            self._watched = None

    def _end(self, result: Any, error: Exception | None) -> None:
        if error is None:
            result = self._line.with_time(result)
        elif isinstance(error, LinkDownError):
            self._lose_port(error)
        elif isinstance(error, HeldBack):
            error = self._put_off(error)
            if error is None:
                return
        elif isinstance(error, ReplyError) and self._attempts is not None:
            error = self._try_again(self._attempts, error)
            if error is None:
                return
        self._job = self._attempts = None
        if self._turns.queue.waiting:
            self.rest()
        self._ended(result, error)

    def _put_off(self, held: HeldBack) -> Exception | None:
        """Let others use the line until the job can be carried out; return the error of a job that cannot wait."""
        if self._job is None:
            return held
        try:
            self._job = self._line.put_off(self._job, held)
        except DriveCommError as error:
            return error
        self.rest()
        self._engine.call_at(held.until, self._resume)
        return None

    def _resume(self) -> None:
        if self._job is not None and self._turn is None and self._ask(self._job.rank):
            self._begin()

    def _try_again(self, attempts: StopAttempts[Any], error: ReplyError) -> Exception | None:
        """Begin the next turn of a stop; return the error that ends the stop if no turn is left."""
        try:
            attempts.after(error)
        except DriveCommError as final:
            return final
        self._job = attempts.job
        self.rest()
        if self._ask(attempts.rank, behind=attempts.behind):
            self._begin()
        return None


class _EngineTurn(ThreadTurn):
    """Turn of an engine's thread, which never sleeps: the engine calls back when the turn comes."""

    __slots__ = ("_called_back", "_engine", "_on_stop")

    def __init__(
        self, rank: Rank, engine: Engine, called_back: Callable[[], None], on_stop: Callable[[], None], *, behind: bool
    ) -> None:
        super().__init__(rank, behind=behind)
        self._engine = engine
        self._called_back = called_back
        self._on_stop = on_stop

    def begin_waiting(self) -> None:
        """Do nothing, because the engine continues with other lines."""

    def wake(self) -> None:
        """Make the engine continue this line."""
        self._engine.call_soon(self._called_back)

    def give_way(self) -> None:
        """Make the engine check soon whether this line's exchange gives way to a stop."""
        self._engine.call_soon(self._on_stop)


def _nobody(_result: Any, _error: Exception | None) -> None:
    pass
