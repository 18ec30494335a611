"""A timer of the Linux kernel (timerfd, its manual page timerfd_create(2)).

A sleep ends 50 microseconds late or later, because the kernel may serve several sleepers together. This timer is exact,
and it has a descriptor, which an event loop can watch.
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


class KernelTimer:
    """Timer on the monotonic clock. Only one thread may wait for it at a time."""

    def __init__(self, descriptor: int, set_time: Callable[[int, bytes], object]) -> None:
        self.descriptor = descriptor
        """Readable from the set time until the timer is set again or cleared."""
        self._set_time = set_time
        self._lead_s = 30e-6

    def set(self, until: float) -> None:
        """Set the timer to a time, which replaces an earlier one. It expires immediately if that time has passed."""
        # A time of zero would disarm the timer.
        seconds, nanoseconds = divmod(int(min(max(until, _EARLIEST_S), _LATEST_S) * _NANOSECONDS), _NANOSECONDS)
        self._set_time(self.descriptor, _TIMER.pack(0, 0, seconds, nanoseconds))

    def clear(self) -> None:
        """Disarm the timer; its descriptor is then not readable."""
        self._set_time(self.descriptor, _TIMER.pack(0, 0, 0, 0))

    def wait(self, until: float) -> None:
        """Wait until this time; never returns earlier."""
        # A process runs again some time after the timer expires. The lead follows the median of that delay: half of the
        # waits end in a busy loop of a few microseconds, and the other half end late by as little.
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
        """Close the descriptor."""
        if self.descriptor >= 0:
            os.close(self.descriptor)
            self.descriptor = -1


def open_timer() -> KernelTimer | None:
    """Return a new timer; None if the system has none, so that the caller must sleep."""
    if sys.platform != "linux":
        return None
    # Loading ctypes takes some milliseconds, which only programs that wait should spend.
    import ctypes

    try:
        # PyDLL keeps the interpreter lock: setting a timer never blocks, and releasing the lock can cost 5 ms.
        library = ctypes.PyDLL(None)
        create, set_time = library.timerfd_create, library.timerfd_settime
    except (OSError, AttributeError):
        return None
    # A blocking descriptor, for `wait`. An event loop never reads it, but sets the timer again.
    descriptor = create(time.CLOCK_MONOTONIC, os.O_CLOEXEC)
    if descriptor < 0:
        return None
    return KernelTimer(descriptor, lambda timer, when: set_time(timer, _ABSOLUTE, when, None))
