"""Spare descriptors, held open to be given up when a process has no other left."""

from __future__ import annotations

import asyncio
import errno
import os
from contextlib import suppress

_EXHAUSTED = frozenset({errno.EMFILE, errno.ENFILE})
_LOOK_S = 1.0


class Spare:
    """Open descriptors of the null device, up to a given number."""

    def __init__(self, count: int) -> None:
        self._count = count
        self._held: list[int] = []

    def __len__(self) -> int:
        return len(self._held)

    def hold(self) -> None:
        """Open descriptors up to the given number, or as many as the system has."""
        with suppress(OSError):
            while len(self._held) < self._count:
                self._held.append(os.open(os.devnull, os.O_RDONLY))

    def give_up(self) -> bool:
        """Close one descriptor for another use; return False if none was left."""
        if not self._held:
            return False
        os.close(self._held.pop())
        return True

    def close(self) -> None:
        """Close all descriptors."""
        while self.give_up():
            pass


async def give_up_when_exhausted(count: int) -> None:
    """Hold this many descriptors until cancelled, but release them while no other is free.

    So a lost port, file or door gets a descriptor at its next attempt to open.
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
    """Return the number of descriptors that can be opened now, up to `most`."""
    tried = Spare(most)
    tried.hold()
    free = len(tried)
    tried.close()
    return free


def is_exhausted(error: OSError) -> bool:
    """Return whether an error means that no descriptor is left."""
    return error.errno in _EXHAUSTED
