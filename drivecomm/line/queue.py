"""The queue of one line: one caller has the line, the others wait by rank. No I/O, no clock, no threads.

A host waits for its callers: `ThreadTurns` for threads, `TaskTurns` for the tasks of an event loop, and `EngineLine`
for a line that shares one thread with others. No host decides whose turn it is.
"""

from __future__ import annotations

from enum import IntEnum

from drivecomm.errors import LineBusyError, UsageError


class Rank(IntEnum):
    """The urgency of a call: stops go before commands and writes, these before reads, and reads before polls.

    SURVEY is for requests to a line as a whole, such as a scan. Waiting polls and surveys keep a share of the turns,
    see `TURNS_PER_POLL`; only stops and commands always go first.
    """

    STOP = 0
    COMMAND = 1
    READ = 2
    POLL = 3
    SURVEY = 4


TURNS_PER_POLL = 2
"""Every second turn below the rank of a command goes to a waiting poll.

Polls watch for faults, and every user who may see a plant may read: without a share, readers who want more than the
line can carry would leave its drives unwatched. A poll plan that fits into half of the line's time stays up to date
under any number of reads, and a read waits for at most one poll.
"""
TURNS_PER_SURVEY = 6
"""Every sixth of these turns goes to a waiting survey, which is not urgent but must come to an end."""

# Local names, because looking up an enumeration member calls a Python function.
_STOP, _COMMAND = Rank.STOP, Rank.COMMAND
_SHARES = {Rank.POLL: TURNS_PER_POLL, Rank.SURVEY: TURNS_PER_SURVEY}


class QueueEntry:
    """Entry of one caller in the queue; it exists from before the caller waits until its turn is over.

    behind: whether all others of its rank go first, whenever they come. caller: the thread or task that waits.
    """

    __slots__ = ("behind", "caller", "order", "rank")

    def __init__(self, rank: Rank, caller: object, *, behind: bool = False) -> None:
        self.rank = rank
        self.caller = caller
        self.behind = behind
        self.order = 0

    def is_alive(self) -> bool:
        """Return whether the caller still has its turn, or still waits for it."""
        raise NotImplementedError

    def begin_waiting(self) -> None:
        """Prepare for `wake`; called before the entry joins the queue."""
        raise NotImplementedError

    def wake(self) -> None:
        """Wake the caller, which has the line now."""
        raise NotImplementedError

    def give_way(self) -> None:
        """Notify the caller, which has the line, that a stop waits. A blocking caller polls for it instead."""


class LineQueue:
    """Queue of one line. The line passes directly from one caller to the next, so no newcomer slips in between.

    Every step is complete in itself: a caller that is interrupted between two steps costs no other caller its turn.
    """

    __slots__ = ("_last_order", "_passed_over", "owner", "waiting")

    def __init__(self) -> None:
        self.owner: QueueEntry | None = None
        """The entry that has the line; its caller may be gone."""
        self.waiting: list[QueueEntry] = []
        """The waiting entries, in no order."""
        self._last_order = 0
        self._passed_over = dict.fromkeys(_SHARES, 0)

    def ask(self, place: QueueEntry) -> bool:
        """Return True if the line is free and the turn has come immediately; otherwise the entry waits to be woken.

        Raises UsageError if the caller has the line already, such as in a trace function.
        """
        owner = self.owner
        is_taken = owner is not None and owner.is_alive()
        if not is_taken and not self.waiting:
            self.owner = place
            return True
        if is_taken and owner is not None and owner.caller == place.caller:
            raise UsageError("a trace function cannot use the bus that calls it")
        self._last_order += 1
        place.order = self._last_order
        place.begin_waiting()
        self.waiting.append(place)
        if place.rank is _STOP and owner is not None:
            owner.give_way()
        return False

    def has_come(self, place: QueueEntry) -> bool:
        """Return whether the turn of a waiting entry has come."""
        self.hand_on()
        return self.owner is place

    def leave(self, place: QueueEntry) -> bool:
        """Stop waiting; returns False if the turn has come meanwhile."""
        self.waiting = [each for each in self.waiting if each is not place]
        return self.owner is not place

    def hand_on(self) -> None:
        """Wake the next caller if the last turn is over."""
        owner = self.owner
        if owner is not None and owner.is_alive():
            return
        alive = [each for each in self.waiting if each.is_alive() and each is not owner]
        if not alive:
            self.owner, self.waiting = None, alive
            return
        first = min(alive, key=_urgency)
        if first.rank > _COMMAND and len(alive) > 1:
            first = self._fair(first, alive)
        self.owner = first
        self.waiting = [each for each in alive if each is not first]
        first.wake()

    def _fair(self, first: QueueEntry, alive: list[QueueEntry]) -> QueueEntry:
        """Return the next of the waiting entries, none of which is a stop or a command."""
        due = first
        for rank, turns in _SHARES.items():
            waiting = [each for each in alive if each.rank is rank]
            if waiting and self._passed_over[rank] + 1 >= turns and due is first:
                due = min(waiting, key=_urgency)
            self._passed_over[rank] += 1 if waiting else -self._passed_over[rank]
        if due.rank in self._passed_over:
            self._passed_over[due.rank] = 0
        return due

    def stop_waits(self) -> bool:
        """Return whether a stop waits for the line."""
        return bool(self.waiting) and self.waits(_STOP)

    def waits(self, rank: Rank) -> bool:
        """Return whether a caller of this rank, or of a more urgent one, waits."""
        return any(each.rank <= rank and each.is_alive() for each in self.waiting)


def _urgency(place: QueueEntry) -> tuple[int, bool, int]:
    return place.rank, place.behind, place.order


def line_was_busy(who: str, seconds: float) -> LineBusyError:
    """Return the error of a caller whose turn did not come in time."""
    return LineBusyError(f"{who}: the line was busy with others for {seconds:g} s")
