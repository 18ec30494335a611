"""Whose turn it is on a line: requests queue by priority, then first come, first served."""

from __future__ import annotations

import time
from enum import IntEnum
from threading import Lock, get_ident
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable


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
        self.called: Lock | Bell = Lock()
        self.order = 0
        self.thread = get_ident()

    def overtaken(self) -> None:
        """Be told that a stop waits, while this is whose turn it is; who blocks looks by themselves."""


class Bell:
    """Stands in for the lock that a thread sleeps on, for a turn whose thread does other things meanwhile.

    ring: called from whatever thread when it is the turn's turn.
    """

    __slots__ = ("_ring", "_silent")

    def __init__(self, ring: Callable[[], None]) -> None:
        self._ring = ring
        self._silent = False

    def acquire(self, *, timeout: float = -1) -> None:  # noqa: ARG002 - nobody sleeps on it
        """Be silent until the turn is called."""
        self._silent = True

    def locked(self) -> bool:
        """Whether the turn has not been called."""
        return self._silent

    def release(self) -> None:
        """Call the turn."""
        self._silent = False
        self._ring()


class PriorityLock:
    """A line among threads. It is handed from one to the next, so that nobody slips in between."""

    def __init__(self) -> None:
        self._guard = Lock()
        self._owner: Turn | None = None
        self.waiting: list[Turn] = []
        """Who waits, in no order; for others to look whether it is empty."""
        self._order = 0

    def wait(self, turn: Turn, seconds: float) -> bool:
        """Wait for a turn that was asked for; returns False when it has not come within this time."""
        until = time.monotonic() + seconds
        while not self.has_come(turn):
            left = until - time.monotonic()
            if left <= 0:
                return not self.leave(turn)
            # Whoever was interrupted while handing on has called nobody, so everybody looks now and then.
            turn.called.acquire(timeout=min(left, LOOK_S))
        return True

    def ask(self, turn: Turn) -> bool:
        """Return True if a turn that is held already has come at once; it waits otherwise, until it is called."""
        with self._guard:
            owner = self._owner
            if not self.waiting and (owner is None or not owner.held.locked()):
                self._owner = turn
                return True
            self._order += 1
            turn.order = self._order
            turn.called.acquire()
            self.waiting.append(turn)
        if turn.rank is Rank.STOP and owner is not None:
            owner.overtaken()
        return False

    def has_come(self, turn: Turn) -> bool:
        """Whether a turn that was asked for has come."""
        with self._guard:
            self._call_next()
            return self._owner is turn

    def leave(self, turn: Turn) -> bool:
        """Wait no more; returns False when the turn has come meanwhile."""
        with self._guard:
            self.waiting = [waiting for waiting in self.waiting if waiting is not turn]
            return self._owner is not turn

    def hand_on(self) -> None:
        """Call the next one, after a turn is over."""
        if self.waiting:
            with self._guard:
                self._call_next()

    def stop_waits(self) -> bool:
        """Whether somebody waits who wants to stop something."""
        return bool(self.waiting) and any(turn.rank is Rank.STOP and turn.held.locked() for turn in self.waiting)

    def is_mine_besides(self, turn: Turn) -> bool:
        """Whether this thread has another turn than this one, which may have come since it was asked for."""
        owner = self._owner
        return owner is not None and owner is not turn and owner.thread == get_ident() and owner.held.locked()

    def _is_taken(self) -> bool:
        return self._owner is not None and self._owner.held.locked()

    def _call_next(self) -> None:
        # Each step is whole in itself, so that whoever is interrupted between two of them loses nothing.
        if self._is_taken():
            return
        alive = [turn for turn in self.waiting if turn.held.locked() and turn is not self._owner]
        if not alive:
            self._owner, self.waiting = None, alive
            return
        first = min(alive, key=lambda turn: (turn.rank, turn.order))
        self._owner = first
        self.waiting = [turn for turn in alive if turn is not first]
        if first.called.locked():
            first.called.release()


LOOK_S = 0.02
"""How often who waits looks whether its turn has come, uncalled."""
