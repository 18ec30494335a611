"""Whose turn it is on a line: requests queue by priority, then first come, first served."""

from __future__ import annotations

import time
from enum import IntEnum
from threading import Lock, get_ident


class Rank(IntEnum):
    """How urgent a call is: stopping overtakes commands and writes, they overtake readings, and all overtake polls."""

    STOP = 0
    COMMAND = 1
    READ = 2
    POLL = 3


class Turn:
    """The turn of one call, from before it waits until it is over.

    `with turn.held:` goes around all of that. It is a lock of the interpreter's own, which no signal handler can come
    between: however the block is left, by Ctrl-C at any instruction too, the turn is over, and the others see it.
    """

    __slots__ = ("called", "held", "order", "rank", "thread")

    def __init__(self, rank: Rank) -> None:
        self.rank = rank
        self.held = Lock()
        self.called = Lock()
        self.order = 0
        self.thread = get_ident()


class PriorityLock:
    """A line among threads. It is handed from one to the next, so that nobody slips in between."""

    def __init__(self) -> None:
        self._guard = Lock()
        self._owner: Turn | None = None
        self._waiting: list[Turn] = []
        self._order = 0

    def take(self, turn: Turn, seconds: float) -> bool:
        """Wait for a turn that is held already; returns False when it has not come within this time."""
        with self._guard:
            if not self._waiting and not self._is_taken():
                self._owner = turn
                return True
            self._order += 1
            turn.order = self._order
            turn.called.acquire()
            self._waiting.append(turn)
        until = time.monotonic() + seconds
        while True:
            with self._guard:
                self._call_next()
                if self._owner is turn:
                    return True
            left = until - time.monotonic()
            if left <= 0:
                break
            # Whoever was interrupted while handing on has called nobody, so everybody looks now and then.
            turn.called.acquire(timeout=min(left, _LOOK_S))
        with self._guard:
            if self._owner is turn:
                return True
            self._waiting = [waiting for waiting in self._waiting if waiting is not turn]
            return False

    def hand_on(self) -> None:
        """Call the next one, after a turn is over."""
        if self._waiting:
            with self._guard:
                self._call_next()

    def stop_waits(self) -> bool:
        """Whether somebody waits who wants to stop something."""
        return bool(self._waiting) and any(turn.rank is Rank.STOP and turn.held.locked() for turn in self._waiting)

    def is_mine(self) -> bool:
        """Whether this thread has its turn."""
        owner = self._owner
        return owner is not None and owner.thread == get_ident() and owner.held.locked()

    def _is_taken(self) -> bool:
        return self._owner is not None and self._owner.held.locked()

    def _call_next(self) -> None:
        # Each step is whole in itself, so that whoever is interrupted between two of them loses nothing.
        if self._is_taken():
            return
        alive = [turn for turn in self._waiting if turn.held.locked() and turn is not self._owner]
        if not alive:
            self._owner, self._waiting = None, alive
            return
        first = min(alive, key=lambda turn: (turn.rank, turn.order))
        self._owner = first
        self._waiting = [turn for turn in alive if turn is not first]
        if first.called.locked():
            first.called.release()


_LOOK_S = 0.02
