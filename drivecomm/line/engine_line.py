"""A line among many that one thread serves: it carries out jobs as `ThreadLine.run` does, and never blocks."""

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
    from drivecomm.line.loop import Engine
    from drivecomm.line.stopping import StopAttempts
    from drivecomm.line.thread_line import ThreadLine
    from drivecomm.link import Port


class EngineLine:
    """One line on an engine. One job at a time; other threads use the line between two of them, by rank."""

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
        """Carry out a job when it is its turn. ended: told its result or its error, maybe before this returns.

        The turn is kept after it if nobody else waits, so that the next job can follow at once; `rest` gives it back.
        """
        self._job, self._ended = job, ended
        try:
            self._deadline = deadline = self._line.called(job)
        except Exception as error:  # noqa: BLE001 - whoever wants the job is told
            self._end(None, error)
            return
        self._attempts = self._tried_before = None
        if job.rank is Rank.STOP:
            self._attempts, self._tried_before = self._line.attempts(job), self._line.failed_openings
            if self._has_turn or self._ask(job.rank, behind=self._attempts.behind):
                self._begin()
        elif self._has_turn and self._runner is not None:
            # Nobody else can have opened or lost the port meanwhile.
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
        """Cut off what is under way, and give back the turn."""
        if self._runner is not None:
            self._runner.cut_off()
        self._job = None
        self.rest()

    def _ask(self, rank: Rank, *, behind: bool = False) -> bool:
        """Return whether it is this line's turn at once; it is called otherwise."""
        turn = self._turn = _EngineTurn(rank, self._engine, self._called_back, self._give_way, behind=behind)
        turn.held.acquire()
        self._has_turn = self._turns.ask(turn)
        if not self._has_turn:
            self._engine.call_at(self._now() + LOOK_S, self._called_back)
        return self._has_turn

    def _called_back(self) -> None:
        """Begin if it is this line's turn now, and end the job when its time is over."""
        turn, job = self._turn, self._job
        if turn is None or self._has_turn or job is None:
            return
        if not self._turns.has_come(turn):
            if (now := self._now()) < self._deadline:
                # Whoever was interrupted while handing on has called nobody, so everybody looks now and then.
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
        """Carry out the job, now that it is this line's turn."""
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
        """Open the port again, in a thread of its own."""
        try:
            self._line.opened(self._tried_before)
        except Exception as error:  # noqa: BLE001 - whoever wants the job is told
            failed = error
            self._engine.call_soon(lambda: self._end(None, failed))
        else:
            self._engine.call_soon(self._begin)

    def _wake_at(self, until: float) -> None:
        # An earlier one is left to come and then set anew: most replies come long before it.
        if until < self._woken_at:
            self._woken_at = until
            self._engine.call_at(until, self._timed)

    def _timed(self) -> None:
        self._woken_at = float("inf")
        if self._runner is not None:
            self._runner.timed()

    def _wake_precisely(self, until: float) -> None:
        self._engine.call_at(until, self._paused)

    def _paused(self) -> None:
        if self._runner is not None:
            self._runner.timed()

    def _lose_port(self, _error: LinkDownError) -> None:
        # A descriptor that is closed cannot be watched.
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
            result = self._line.timed(result)
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
        """Let others have the line until the job can be carried out; returns the error of one that cannot wait."""
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
        """Begin the next turn of a stop; returns the error that ends it if there is none."""
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
    """A turn of an engine's thread, which never sleeps: the engine calls it back."""

    __slots__ = ("_called_back", "_engine", "_on_stop")

    def __init__(
        self, rank: Rank, engine: Engine, called_back: Callable[[], None], on_stop: Callable[[], None], *, behind: bool
    ) -> None:
        super().__init__(rank, behind=behind)
        self._engine = engine
        self._called_back = called_back
        self._on_stop = on_stop

    def begin_waiting(self) -> None:
        """Do nothing: the engine goes on with other lines."""

    def wake(self) -> None:
        """Have the engine continue this line."""
        self._engine.call_soon(self._called_back)

    def give_way(self) -> None:
        """Have the line look at once whether it gives way."""
        self._engine.call_soon(self._on_stop)


def _nobody(_result: Any, _error: Exception | None) -> None:
    pass
