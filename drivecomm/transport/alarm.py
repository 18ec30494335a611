"""An alarm clock of the Linux kernel (timerfd, its manual page timerfd_create(2)).

Sleeping ends 50 microseconds late or later, because the kernel may then serve several sleepers at once; this alarm does
not, and it has a descriptor, which an event loop can watch.
"""

from __future__ import annotations

import os
import struct
import sys
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

# struct itimerspec: seconds and nanoseconds of the interval (none), seconds and nanoseconds of the first time.
_TIMER = struct.Struct("@llll")
_ABSOLUTE = 1
_NANOSECONDS = 1_000_000_000
_EARLIEST_S = 1e-6
_LATEST_S = 1e9
_LONGEST_LEAD_S = 150e-6
_LEAD_STEP_S = 2e-6

_monotonic = time.monotonic


class Alarm:
    """Rings at a time of the monotonic clock. One thread waits for it at a time."""

    def __init__(self, descriptor: int, set_time: Callable[[int, bytes], object]) -> None:
        self.descriptor = descriptor
        """Readable from the time that was set until it is set again or cleared."""
        self._set_time = set_time
        self._lead_s = 30e-6

    def set(self, until: float) -> None:
        """Ring at this time, at once if it has passed; replaces an earlier one."""
        # A time of zero would switch it off.
        seconds, nanoseconds = divmod(int(min(max(until, _EARLIEST_S), _LATEST_S) * _NANOSECONDS), _NANOSECONDS)
        self._set_time(self.descriptor, _TIMER.pack(0, 0, seconds, nanoseconds))

    def clear(self) -> None:
        """Do not ring, and be readable no longer."""
        self._set_time(self.descriptor, _TIMER.pack(0, 0, 0, 0))

    def wait(self, until: float) -> None:
        """Return at this time, never before."""
        # A process is back on its processor some time after the alarm. The lead follows the median of that, so half of
        # the waits are spun to their end for a few microseconds, and the other half end late by as few.
        lead = self._lead_s
        if until - _monotonic() > lead:
            self.set(until - lead)
            os.read(self.descriptor, 8)
            if _monotonic() > until:
                self._lead_s = min(lead + _LEAD_STEP_S, _LONGEST_LEAD_S)
            else:
                self._lead_s = max(lead - _LEAD_STEP_S, 0.0)
        while _monotonic() < until:
            pass

    def close(self) -> None:
        """Give the descriptor back."""
        if self.descriptor >= 0:
            os.close(self.descriptor)
            self.descriptor = -1


def open_alarm() -> Alarm | None:
    """Return a new alarm; None where the system has none to give, and sleeping must do."""
    if sys.platform != "linux":
        return None
    # It takes some milliseconds to load, which only those who wait need to spend.
    import ctypes

    try:
        # PyDLL keeps the interpreter's lock: setting a timer never blocks, and giving the lock away can cost 5 ms.
        library = ctypes.PyDLL(None)
        create, set_time = library.timerfd_create, library.timerfd_settime
    except (OSError, AttributeError):
        return None
    # The descriptor blocks: who watches it in an event loop never reads it, but sets it anew.
    descriptor = create(time.CLOCK_MONOTONIC, os.O_CLOEXEC)
    if descriptor < 0:
        return None
    return Alarm(descriptor, lambda timer, when: set_time(timer, _ABSOLUTE, when, None))
