"""Descriptors that are held open so that they can be given up for what must work when there is none left."""

from __future__ import annotations

import asyncio
import errno
import os
from contextlib import suppress

_EXHAUSTED = frozenset({errno.EMFILE, errno.ENFILE})
_LOOK_S = 1.0


class Spare:
    """Open descriptors of nothing, at most so many."""

    def __init__(self, count: int) -> None:
        self._count = count
        self._held: list[int] = []

    def __len__(self) -> int:
        return len(self._held)

    def hold(self) -> None:
        """Hold as many as there should be, as far as the system has any."""
        with suppress(OSError):
            while len(self._held) < self._count:
                self._held.append(os.open(os.devnull, os.O_RDONLY))

    def give_up(self) -> bool:
        """Close one of them for another use; return whether there was one."""
        if not self._held:
            return False
        os.close(self._held.pop())
        return True

    def close(self) -> None:
        """Close all of them."""
        while self.give_up():
            pass


async def give_up_when_exhausted(count: int) -> None:
    """Hold this many descriptors until cancelled, and none while this process or the system has no other.

    So a lost port, a file or a door that is opened again finds one when it is tried the next time.
    """
    spare = Spare(count)
    spare.hold()
    try:
        while True:
            free = _free(count)
            if free == 0:
                spare.close()
            elif free == count:
                spare.hold()
            await asyncio.sleep(_LOOK_S)
    finally:
        spare.close()


def _free(most: int) -> int:
    """Return how many descriptors can be opened now, up to this many."""
    tried = Spare(most)
    tried.hold()
    free = len(tried)
    tried.close()
    return free


def is_exhausted(error: OSError) -> bool:
    """Whether an error says that no descriptor is left."""
    return error.errno in _EXHAUSTED
