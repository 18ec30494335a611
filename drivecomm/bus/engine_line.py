"""The line of a `Bus` among many that one thread serves: it carries out jobs as `Bus.run` does, and never blocks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from drivecomm.bus.priority_lock import LOOK_S, Bell, PriorityLock, Rank, Turn
from drivecomm.errors import DeadlineError, LinkDownError
from drivecomm.transport import LineRunner

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.bus.faces import Job
    from drivecomm.link import Port, Steps
    from drivecomm.transport import Engine


@dataclass(frozen=True, slots=True, kw_only=True)
class BusParts:
    """What carries out a job on a bus.

    called: takes note that a job is called for, and returns its deadline. begin: returns its steps, given the deadline
    and the time. timed: gives a reading its time. port: what is open now. opened: opens the port if it was lost, which
    may take its time. lost: closes it.
    """

    lock: PriorityLock
    called: Callable[[Job[Any]], float]
    begin: Callable[[Job[Any], float, float], Steps[Any]]
    timed: Callable[[Any], Any]
    port: Callable[[], Port | None]
    opened: Callable[[], Port]
    lost: Callable[[Port], None]


class EngineLine:
    """The line of one bus on an engine. One job at a time; other threads use the bus between two of them, by rank."""

    def __init__(self, parts: BusParts, engine: Engine) -> None:
        self._parts = parts
        self._lock, self._stop_waits = parts.lock, parts.lock.stop_waits
        self._job_called, self._steps_of, self._timed_result = parts.called, parts.begin, parts.timed
        self._engine = engine
        self._now = engine.now
        self._turn: _EngineTurn | None = None
        self._has_turn = False
        self._port: Port | None = None
        self._runner: LineRunner | None = None
        self._watched: int | None = None
        self._woken_at = float("inf")
        self._job: Job[Any] | None = None
        self._deadline = 0.0
        self._ended: Callable[[Any, Exception | None], None] = _nobody

    def run(self, job: Job[Any], ended: Callable[[Any, Exception | None], None]) -> None:
        """Carry out a job when it is its turn. ended: told its result or its error, maybe before this returns.

        The turn is kept after it if nobody else waits, so that the next job can follow at once; `rest` gives it back.
        """
        self._job, self._ended = job, ended
        try:
            self._deadline = deadline = self._job_called(job)
        except Exception as error:  # noqa: BLE001 - whoever wants the job is told
            self._end(None, error)
            return
        if self._has_turn and self._runner is not None:
            # Nobody else can have opened or lost the port meanwhile.
            self._runner.begin(self._steps_of(job, deadline, self._now()), self._stop_waits)
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
        self._lock.hand_on()

    def close(self) -> None:
        """Cut off what is under way, and give back the turn."""
        if self._runner is not None:
            self._runner.cut_off()
        self._job = None
        self.rest()

    def _ask(self, rank: Rank) -> bool:
        """Return whether it is this line's turn at once; it is called otherwise."""
        turn = self._turn = _EngineTurn(rank, self._engine, self._called, self._give_way)
        turn.held.acquire()
        self._has_turn = self._lock.ask(turn)
        if not self._has_turn:
            self._engine.call_at(self._now() + LOOK_S, self._called)
        return self._has_turn

    def _called(self) -> None:
        """Begin if it is this line's turn now, and end the job when its time is over."""
        turn, job = self._turn, self._job
        if turn is None or self._has_turn or job is None:
            return
        if not self._lock.has_come(turn):
            if (now := self._now()) < self._deadline:
                # Whoever was interrupted while handing on has called nobody, so everybody looks now and then.
                self._engine.call_at(min(now + LOOK_S, self._deadline), self._called)
                return
            if self._lock.leave(turn):
                self._turn = None
                turn.held.release()
                self._lock.hand_on()
                seconds = job.peer.facts.timing.deadline_s
                self._end(None, DeadlineError(f"{job.peer.name}: the line was busy with others for {seconds:g} s"))
                return
        self._has_turn = True
        self._begin()

    def _give_way(self) -> None:
        if self._runner is not None:
            self._runner.give_way()

    def _begin(self) -> None:
        """Carry out the job, now that it is this line's turn."""
        port, job = self._parts.port(), self._job
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
                runner.begin(self._steps_of(job, self._deadline, self._now()), self._stop_waits)

    def _open(self) -> None:
        """Open the port again, in a thread of its own."""
        try:
            self._parts.opened()
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
        if self._port is not None:
            self._parts.lost(self._port)
        self._port = self._runner = None

    def _unwatch(self) -> None:
        if self._watched is not None:
            self._engine.unwatch(self._watched)
            self._watched = None

    def _end(self, result: Any, error: Exception | None) -> None:
        if error is None:
            result = self._timed_result(result)
        elif isinstance(error, LinkDownError):
            self._lose_port(error)
        self._job = None
        if self._lock.waiting:
            self.rest()
        self._ended(result, error)


class _EngineTurn(Turn):
    """A turn of an engine's thread, which is called where others would wake up."""

    __slots__ = ("_engine", "_overtaken")

    def __init__(self, rank: Rank, engine: Engine, called: Callable[[], None], overtaken: Callable[[], None]) -> None:
        super().__init__(rank)
        self._engine = engine
        self._overtaken = overtaken
        self.called = Bell(lambda: engine.call_soon(called))

    def overtaken(self) -> None:
        """Have the line look at once whether it gives way."""
        self._engine.call_soon(self._overtaken)


def _nobody(_result: Any, _error: Exception | None) -> None:
    pass
