"""The attempts of one stop. Between attempts, a stop whose drive does not answer lets other calls use the line.

So the stops of dead drives delay the stop of a running drive by at most one attempt each.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Generic, TypeVar

from drivecomm.errors import OvertakenError, ReplyError
from drivecomm.line.queue import LineQueue, Rank

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.line.job import Job
    from drivecomm.link import CommandCall, CommandHistory, Health
    from drivecomm.protocol import Exchange

T = TypeVar("T")


class StopAttempts(Generic[T]):
    """The turns in which a stop makes its attempts. Every host repeats `job` until `after` raises.

    called: the call of this stop; a later stop of the same drive cancels it, and continues in its place. rank, behind:
    position in the queue of the next turn.
    """

    def __init__(self, job: Job[T], queue: LineQueue, health: Mapping[str, Health], called: CommandCall) -> None:
        known = health.get(job.peer.name)
        self.job = job
        self.rank = Rank.STOP
        self._was_silent = self._is_silent = self.behind = known is not None and known.failed_calls > 0
        self._queue = queue
        self._called = called
        self._turns_left = 0 if job.again is None else job.peer.facts.timing.attempts - 1
        self._broken_off = False

    def yields_to_others(self) -> bool:
        """Return whether to make no more attempts in this turn; the link calls this after each failed attempt.

        A drive that answered before gives way to other stops; a drive that was silent also to reads and commands.
        """
        if not self._broken_off:
            if self._is_silent:
                self._broken_off = self._queue.waits(Rank.READ)
            elif self._turns_left:
                self._broken_off = self._queue.waits(Rank.STOP)
        return self._broken_off

    def after(self, error: ReplyError) -> None:
        """Prepare the next turn after a failed one. Raises the error that ends the stop."""
        job = self.job
        if not self._broken_off or not self._turns_left or job.again is None:
            raise error
        if self._called.cancelled:
            raise OvertakenError(
                f"{job.peer.name} did not answer its stop, and a later stop of it continues in its place"
            ) from error
        self._turns_left -= 1
        self._broken_off, self._is_silent = False, True
        self.job = job._replace(exchange=job.again())
        if self._was_silent:
            # Reads may feed the watchdogs of other motors, so reads called before this attempt go first.
            self.rank, self.behind = Rank.READ, False
        else:
            self.behind = True


def stopping(commands: CommandHistory, name: str, exchange: Exchange[T]) -> Exchange[T]:
    """Run an exchange that stops a drive, or all drives of a protocol, and forget their earlier commands."""
    commands.forget(name)
    return (yield from exchange)
