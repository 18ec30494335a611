"""Turns on a line for threads: they sleep until they are woken."""

from __future__ import annotations

import time
from threading import Lock, get_ident

from drivecomm.line.queue import LineQueue, Place, Rank

LOOK_S = 0.02
"""How often a waiting thread looks whether its turn has come without being woken."""


class ThreadTurn(Place):
    """The turn of one call of a thread.

    `with turn.held:` goes around all of it. That is a lock of the interpreter's own, which no signal handler can come
    between: however the block is left, by Ctrl-C at any instruction too, the turn is over, and the others see it.
    """

    __slots__ = ("called", "held")

    def __init__(self, rank: Rank, *, behind: bool = False) -> None:
        super().__init__(rank, get_ident(), behind=behind)
        self.held = Lock()
        self.called = Lock()

    def is_alive(self) -> bool:
        """Return whether the block around the call has not been left."""
        return self.held.locked()

    def begin_waiting(self) -> None:
        """Lock what the thread sleeps on."""
        self.called.acquire()

    def wake(self) -> None:
        """Wake the thread."""
        if self.called.locked():
            self.called.release()


class ThreadTurns:
    """Hands one line from thread to thread."""

    def __init__(self) -> None:
        self.queue = LineQueue()
        self.stop_waits = self.queue.stop_waits
        self._guard = Lock()

    def ask(self, turn: ThreadTurn) -> bool:
        """Return True if a turn that is held has come at once; otherwise it waits. Raises as `LineQueue.ask`."""
        with self._guard:
            return self.queue.ask(turn)

    def wait(self, turn: ThreadTurn, seconds: float) -> bool:
        """Wait for a turn that was asked for; returns False if it has not come within this time."""
        until = time.monotonic() + seconds
        while not self.has_come(turn):
            left = until - time.monotonic()
            if left <= 0:
                return not self.leave(turn)
            # A thread that was interrupted while handing on has woken nobody, so all look now and then.
            turn.called.acquire(timeout=min(left, LOOK_S))
        return True

    def has_come(self, turn: ThreadTurn) -> bool:
        """Return whether a turn that was asked for has come."""
        with self._guard:
            return self.queue.has_come(turn)

    def leave(self, turn: ThreadTurn) -> bool:
        """Stop waiting; returns False if the turn has come meanwhile."""
        with self._guard:
            return self.queue.leave(turn)

    def hand_on(self) -> None:
        """Wake the next thread after a turn is over."""
        if self.queue.waiting:
            with self._guard:
                self.queue.hand_on()
