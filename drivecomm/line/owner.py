"""What a line is, whoever waits for it: its port and how that is opened again, the link, the queue, one job at a time.

Nothing here waits. A host does, for turns and for the port: `ThreadLine` for threads, `TaskLine` for the tasks of an
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
    from drivecomm.link import Commands, HeldBack, Link, Port, Steps

    class Turns(Protocol):
        """How a line is handed from caller to caller."""

        queue: LineQueue


T = TypeVar("T")

# An enumeration looks its members up by a function of Python's.
_STOP = Rank.STOP


class LineOwner:
    """One line and its port.

    open_port: opens the port, at once and again after it was lost. link, commands: of this line.
    on_opened: told each port that was opened. on_close: called when the line has been closed.
    """

    _opened_with: str
    """What opens a line again that was closed."""

    _new_turns: Callable[[], Turns]
    """Makes what hands the line from caller to caller."""

    def __init__(
        self,
        open_port: Callable[[], Port],
        link: Link,
        commands: Commands,
        on_opened: Callable[[Port], None],
        on_close: Callable[[], None] | None = None,
    ) -> None:
        self.turns = self._new_turns()
        self.queue = self.turns.queue
        """The callers of this line: who has it, and who waits."""
        self.open_port = open_port
        self.port: Port | None = None
        """The port, None while it is not open."""
        self.clock: Port | None = None
        """The port that was opened last, whose clock goes on when it is lost; None before that."""
        self.failed_openings = 0
        self._link = link
        self._commands = commands
        self._on_opened = on_opened
        self._on_close = on_close
        self._closed = False
        self._reopening = Backoff(REOPEN_FIRST_S, REOPEN_LONGEST_S)
        link.stop_waits = self.queue.stop_waits

    def now(self) -> float:
        """Return the time on the line's clock, in seconds. Raises UsageError for a line that is closed, or not open."""
        self.check_open()
        if self.clock is None:
            raise UsageError("this bus is not open; use it in `async with`")
        return self.clock.now()

    @property
    def real_time(self) -> bool:
        """Whether time passes by itself, as it does everywhere but on a virtual line."""
        return self.clock is None or self.clock.real_time

    @property
    def condition(self) -> str:
        """Whether the port is open, in a word or two."""
        if self._closed:
            return "closed"
        if self.port is not None:
            return "open"
        return "not open yet" if self.clock is None else "port lost"

    def check_open(self) -> None:
        """Raise UsageError for a line that was closed."""
        if self._closed:
            raise UsageError(f"this bus is closed; open it again with {self._opened_with}")

    def called(self, job: Job[Any]) -> float:
        """Take note that a job is called for, which a stop may cancel; returns when its time is over."""
        # Whether the line is open is for those to say who find that it is not.
        now = self.now() if self._closed or self.clock is None else self.clock.now()
        if job.rank is _STOP:
            self._commands.stop_called(job.peer.name)
        return now + job.peer.facts.timing.deadline_s

    def attempts(self, job: Job[T]) -> StopAttempts[T]:
        """Return the attempts of a stop that was called just now."""
        return StopAttempts(job, self.queue, self._link.health, self._commands.called(job.peer.name))

    def begin(self, job: Job[T], deadline: float, now: float, attempts: StopAttempts[T] | None = None) -> Steps[T]:
        """Return the steps that carry out a job on the link, beginning now. attempts: those of a stop."""
        link = self._link
        if job.rank is _STOP:
            exchange = stopping(self._commands, job.peer.name, job.exchange)
            others_first = None if attempts is None else attempts.others_first
            return link.stop(job.peer, exchange, now, deadline=deadline, others_first=others_first)
        if job.insists:
            return link.insist(job.peer, job.exchange, now, deadline=deadline)
        return link.run(job.peer, job.exchange, now, deadline, job.command)

    def put_off(self, job: Job[T], held: HeldBack) -> Job[T]:
        """Return the job that is carried out later, for one that was held back. Raises HeldBackError for a poll."""
        if job.rank is Rank.POLL:
            held.exchange.close()
            raise HeldBackError(
                f"{job.peer.name} was not asked: a late reply to an earlier question could be taken for its answer",
                held.until,
            ) from None
        return Job(job.peer, held.exchange, job.rank, job.command, job.insists)

    def timed(self, result: T) -> T:
        """Return what a job has resulted in; a reading gets its time, and why it is in doubt."""
        if isinstance(result, Reading) and self.clock is not None:
            result.at(self.clock.wall_time())
        if doubt := self._link.doubt:
            for each in result if isinstance(result, list) else (result,):
                if isinstance(each, Reading):
                    each.doubted(doubt)
        return result

    def check_backoff(self, tried_before: int | None) -> None:
        """Raise LinkDownError as long as a port that was lost is not to be opened again.

        tried_before: the openings that had failed when a stop was called for; it waits for that only if the port has
        been tried in vain since: so the stops of many drives do not try it one after the other. None for other jobs.
        """
        self.check_open()
        if self.clock is None or tried_before == self.failed_openings:
            return
        if (left_s := self._reopening.over_at - self.clock.now()) > 0:
            raise LinkDownError(f"the port was lost; it is opened again in {left_s:.1f} s")

    def opening_failed(self) -> None:
        """Take note that the port could not be opened."""
        if self.clock is not None:
            self.failed_openings += 1
            self._reopening.failed(self.clock.now())

    def was_opened(self, port: Port) -> None:
        """Take a port that was opened just now."""
        self._reopening.succeeded()
        self._link.paced = port.paced
        self._on_opened(port)
        self._link.opened(port.now())
        if self.clock is not None:
            self._link.reopened()
        self.port = self.clock = port

    def let_go(self) -> None:
        """Give the port back, if it is open; whoever comes next opens it again."""
        port, self.port = self.port, None
        if port is not None:
            port.close()

    def check_no_stop_waits(self) -> None:
        """Raise LinkDownError as soon as a stop waits, to which whoever has the port for a while gives way."""
        if self.queue.stop_waits():
            raise LinkDownError("the port was given back in the middle, because a stop goes first")

    def shut(self) -> None:
        """Give the port back for good; called by a host, in a turn of its own."""
        self._closed = True
        self.let_go()
        if self._on_close is not None:
            self._on_close()
