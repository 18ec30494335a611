"""Turns on a line for threads, which sleep until they are woken."""

from __future__ import annotations

import time
from threading import Lock, get_ident

from drivecomm.line.queue import LineQueue, QueueEntry, Rank

LOOK_S = 0.02
"""Interval in seconds at which a waiting thread checks for its turn, in case it was not woken."""


class ThreadTurn(QueueEntry):
    """Turn of one call of a thread.

    `with turn.held:` encloses the whole turn. It is a lock of the interpreter itself, which a signal handler cannot
    interrupt: in whatever way the block is left, even by Ctrl-C at any instruction, the turn is over, and the other
    threads see it.
    """

    __slots__ = ("called", "held")

    def __init__(self, rank: Rank, *, behind: bool = False) -> None:
        super().__init__(rank, get_ident(), behind=behind)
        self.held = Lock()
        self.called = Lock()

    def is_alive(self) -> bool:
        """Return whether the block around the call has not been left yet."""
        return self.held.locked()

    def begin_waiting(self) -> None:
        """Acquire the lock on which the thread sleeps."""
        self.called.acquire()

    def wake(self) -> None:
        """Wake the thread."""
        if self.called.locked():
            self.called.release()


class ThreadTurns:
    """Turns of one line among threads."""

    def __init__(self) -> None:
        self.queue = LineQueue()
        self.stop_waits = self.queue.stop_waits
        self._guard = Lock()

    def ask(self, turn: ThreadTurn) -> bool:
        """Return True if the turn has come immediately; otherwise it waits. `turn.held` must be locked.

        Raises the errors of `LineQueue.ask`.
        """
        with self._guard:
            return self.queue.ask(turn)

    def wait(self, turn: ThreadTurn, seconds: float) -> bool:
        """Wait for a requested turn; return False if it does not come within this time."""
        until = time.monotonic() + seconds
        while not self.has_come(turn):
            left = until - time.monotonic()
            if left <= 0:
                return not self.leave(turn)
            # An interrupted thread may have ended its turn without waking another, so every waiting thread polls.
            turn.called.acquire(timeout=min(left, LOOK_S))
        return True

    def has_come(self, turn: ThreadTurn) -> bool:
        """Return whether a requested turn has come."""
        with self._guard:
            return self.queue.has_come(turn)

    def leave(self, turn: ThreadTurn) -> bool:
        """Stop waiting; return False if the turn has come meanwhile."""
        with self._guard:
            return self.queue.leave(turn)

    def hand_on(self) -> None:
        """Wake the next thread after a turn is over."""
        if self.queue.waiting:
            with self._guard:
                self.queue.hand_on()
