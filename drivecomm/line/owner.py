"""State of a line that is common to all hosts: its port and its reopening, the link, the queue, one job at a time.

Nothing here waits. A host waits for turns and for the port: `ThreadLine` for threads, `TaskLine` for the tasks of an
event loop, and `EngineLine` for a line that shares one thread with others.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from drivecomm.errors import HeldBackError, LinkDownError, UsageError
from drivecomm.line.job import Job
from drivecomm.line.queue import Rank
from drivecomm.line.stopping import StopAttempts, stopping
from drivecomm.link import REOPEN_FIRST_S, REOPEN_LONGEST_S, Backoff
from drivecomm.protocol import Reading

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.line.queue import LineQueue
    from drivecomm.link import CommandHistory, HeldBack, Link, LinkSteps, Port

    class Turns(Protocol):
        """Interface that hands a line from caller to caller."""

        queue: LineQueue


T = TypeVar("T")

# A local name, because looking up an enumeration member calls a Python function.
_STOP = Rank.STOP


class LineOwner:
    """One line and its port.

    open_port: opens the port, now and again after it was lost. link, commands: link and command history of this line.
    on_opened: called with each port that was opened. on_close: called after the line was closed.
    """

    _opened_with: str
    """Name of the function that opens a closed line again."""

    _new_turns: Callable[[], Turns]
    """Factory of the object that hands the line from caller to caller."""

    def __init__(
        self,
        open_port: Callable[[], Port],
        link: Link,
        commands: CommandHistory,
        on_opened: Callable[[Port], None],
        on_close: Callable[[], None] | None = None,
    ) -> None:
        self.turns = self._new_turns()
        self.queue = self.turns.queue
        """The callers of this line: the one that has it, and those that wait."""
        self.open_port = open_port
        self.port: Port | None = None
        """The port; None while it is not open."""
        self.clock: Port | None = None
        """The last opened port, whose clock continues after a loss; None before the first opening."""
        self.failed_openings = 0
        self._link = link
        self._commands = commands
        self._on_opened = on_opened
        self._on_close = on_close
        self._closed = False
        self._reopening = Backoff(REOPEN_FIRST_S, REOPEN_LONGEST_S)
        link.stop_waits = self.queue.stop_waits

    def now(self) -> float:
        """Return the time on the line's clock in seconds. Raises UsageError if the line is closed or not open yet."""
        self.check_open()
        if self.clock is None:
            raise UsageError("this bus is not open; use it in `async with`")
        return self.clock.now()

    @property
    def real_time(self) -> bool:
        """Whether time passes by itself, as on every line except a virtual one."""
        return self.clock is None or self.clock.real_time

    @property
    def condition(self) -> str:
        """State of the port in a word or two, such as "open"."""
        if self._closed:
            return "closed"
        if self.port is not None:
            return "open"
        return "not open yet" if self.clock is None else "port lost"

    def check_open(self) -> None:
        """Raise UsageError if the line was closed."""
        if self._closed:
            raise UsageError(f"this bus is closed; open it again with {self._opened_with}")

    def called(self, job: Job[Any]) -> float:
        """Register the call of a job, and return its deadline. A stop cancels earlier commands of its drive."""
        # A line that is not open is reported later, where the port is needed.
        now = self.now() if self._closed or self.clock is None else self.clock.now()
        if job.rank is _STOP:
            self._commands.stop_called(job.peer.name)
        return now + job.peer.facts.timing.deadline_s

    def attempts(self, job: Job[T]) -> StopAttempts[T]:
        """Return the attempts of a stop that was just called."""
        return StopAttempts(job, self.queue, self._link.health, self._commands.called(job.peer.name))

    def begin(self, job: Job[T], deadline: float, now: float, attempts: StopAttempts[T] | None = None) -> LinkSteps[T]:
        """Return the link's steps for a job that begins now. attempts: attempts of a stop."""
        link = self._link
        if job.rank is _STOP:
            exchange = stopping(self._commands, job.peer.name, job.exchange)
            others_first = None if attempts is None else attempts.yields_to_others
            return link.stop(job.peer, exchange, now, deadline=deadline, others_first=others_first)
        if job.insists:
            return link.insist(job.peer, job.exchange, now, deadline=deadline)
        return link.run(job.peer, job.exchange, now, deadline, job.command)

    def put_off(self, job: Job[T], held: HeldBack) -> Job[T]:
        """Return the job to carry out later in place of one that was held back. Raises HeldBackError for a poll."""
        if job.rank is Rank.POLL:
            held.exchange.close()
            raise HeldBackError(
                f"{job.peer.name} was not asked: a late reply to an earlier question could be taken for its answer",
                held.until,
            ) from None
        return Job(job.peer, held.exchange, job.rank, job.command, job.insists)

    def with_time(self, result: T) -> T:
        """Return the result of a job; a reading gets its time, and the reason if it is in doubt."""
        if isinstance(result, Reading) and self.clock is not None:
            result.at(self.clock.wall_time())
        if doubt := self._link.doubt:
            for each in result if isinstance(result, list) else (result,):
                if isinstance(each, Reading):
                    each.doubted(doubt)
        return result

    def check_backoff(self, tried_before: int | None) -> None:
        """Raise LinkDownError while a lost port must not be reopened yet.

        tried_before: number of failed openings when a stop was called; None for other jobs. The stop waits only if
        another opening has failed since, so that the stops of many drives do not try a dead port one after the other.
        """
        self.check_open()
        if self.clock is None or tried_before == self.failed_openings:
            return
        if (left_s := self._reopening.over_at - self.clock.now()) > 0:
            raise LinkDownError(f"the port was lost; it is opened again in {left_s:.1f} s")

    def opening_failed(self) -> None:
        """Record that the port could not be opened."""
        if self.clock is not None:
            self.failed_openings += 1
            self._reopening.failed(self.clock.now())

    def was_opened(self, port: Port) -> None:
        """Store a port that was just opened."""
        self._reopening.succeeded()
        self._link.paced = port.paced
        self._on_opened(port)
        self._link.opened(port.now())
        if self.clock is not None:
            self._link.reopened()
        self.port = self.clock = port

    def let_go(self) -> None:
        """Close the port, if it is open; the next job opens it again."""
        port, self.port = self.port, None
        if port is not None:
            port.close()

    def check_no_stop_waits(self) -> None:
        """Raise LinkDownError if a stop waits, so that the borrower of the port gives way to it."""
        if self.queue.stop_waits():
            raise LinkDownError("the port was given back in the middle, because a stop goes first")

    def shut(self) -> None:
        """Close the port for good; called by a host in a turn of its own."""
        self._closed = True
        self.let_go()
        if self._on_close is not None:
            self._on_close()
