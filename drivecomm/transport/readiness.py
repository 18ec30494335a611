"""Waiting until a descriptor is readable or writable, accurate to a fraction of a millisecond.

poll is the fastest way to wait, but counts whole milliseconds: rounding up would cost up to one millisecond per silent
drive of a scan. So poll waits for the whole milliseconds, and select, which counts microseconds, for the rest.
"""

from __future__ import annotations

import math
import select
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

_SHORTEST_POLL_S = 0.001
_LONGEST_S = 3600.0
# Size of a descriptor set on every system but Windows, where descriptors have no order (POSIX, <sys/select.h>).
_SELECTABLE = 1024

_monotonic = time.monotonic


class Readable:
    """Waiter for a descriptor that becomes readable when bytes arrive or the other end is gone."""

    def __init__(self, descriptor: int) -> None:
        self._descriptors = (descriptor,)
        self._poll: Callable[[float], object] | None = None
        # Windows has no poll, and its select has no relevant limit.
        if hasattr(select, "poll"):
            poller = select.poll()
            poller.register(descriptor, select.POLLIN)
            self._poll = poller.poll
        self._selectable = self._poll is None or descriptor < _SELECTABLE

    def now(self) -> bool:
        """Return whether the descriptor is readable now."""
        return bool(self._poll(0)) if self._poll is not None else self._select(0.0)

    def wait(self, until: float) -> bool:
        """Return True as soon as the descriptor is readable, False at `until`."""
        while (left := until - _monotonic()) > 0:
            if self._poll is not None and left > _SHORTEST_POLL_S:
                whole = min(left, _LONGEST_S) * 1000
                if self._poll(int(whole) if self._selectable else math.ceil(whole)):
                    return True
            elif self._selectable:
                if self._select(min(left, _LONGEST_S)):
                    return True
            elif self._poll is not None and self._poll(1):
                return True
        return self.now()

    def _select(self, wait_s: float) -> bool:
        return bool(select.select(self._descriptors, (), (), wait_s)[0])


def send_all(write: Callable[[bytes], int], descriptor: int, data: bytes, limit_s: float) -> bool:
    """Write all bytes to a non-blocking descriptor; return False if that takes longer than limit_s seconds."""
    until = 0.0
    while True:
        try:  # noqa: SIM105
            data = data[write(data) :]
        except BlockingIOError:
            # This is rare, and `contextlib.suppress` would cost a microsecond each time.
            pass
        if not data:
            return True
        now = _monotonic()
        until = until or now + limit_s
        if now >= until:
            return False
        _wait_writable(descriptor, until - now)


def _wait_writable(descriptor: int, wait_s: float) -> None:
    if hasattr(select, "poll"):
        poller = select.poll()
        poller.register(descriptor, select.POLLOUT)
        poller.poll(math.ceil(wait_s * 1000))
    else:
        select.select((), (descriptor,), (), wait_s)
