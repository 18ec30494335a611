"""Event loop for many lines in one thread: one selector for their ports, one kernel timer for their pauses."""

from __future__ import annotations

import contextlib
import heapq
import select
import selectors
import socket
import time
from collections import deque
from threading import Thread
from typing import TYPE_CHECKING

from drivecomm.transport import open_timer

if TYPE_CHECKING:
    from collections.abc import Callable

# Typical delay between the end of the kernel timer and the wake-up of the thread.
_LEAD_S = 25e-6

_monotonic = time.monotonic


class Engine:
    """Event loop that calls functions when a descriptor is readable or a time has come, in the thread of `run`.

    A called function must not block: blocking work is done `aside`. Other threads may use only `call_soon`.
    """

    def __init__(self) -> None:
        self._ears: _Epoll | _Selector = _Epoll() if hasattr(select, "epoll") else _Selector()
        self._soon: deque[Callable[[], None]] = deque()
        self._timers: list[tuple[float, int, Callable[[], None]]] = []
        self._number = 0
        self._woken, self._waker = socket.socketpair()
        self._woken.setblocking(False)
        self._waker.setblocking(False)
        self._asleep = False
        self._ears.watch(self._woken.fileno(), self._empty_pipe)
        self._alarm = open_timer()
        self._alarm_at = float("inf")
        if self._alarm is not None:
            self._ears.watch(self._alarm.descriptor, _nothing)

    # The monotonic clock, in seconds. A method around it would double its cost.
    now = staticmethod(_monotonic)

    def watch(self, descriptor: int, readable: Callable[[], None]) -> None:
        """Call `readable` whenever the descriptor is readable."""
        self._ears.watch(descriptor, readable)

    def unwatch(self, descriptor: int) -> None:
        """Stop watching this descriptor."""
        self._ears.unwatch(descriptor)

    def call_at(self, when: float, timed: Callable[[], None]) -> None:
        """Call a function at a time of the monotonic clock, or a fraction of a millisecond earlier."""
        self._number += 1
        heapq.heappush(self._timers, (when, self._number, timed))

    def call_soon(self, called: Callable[[], None]) -> None:
        """Call a function soon in the engine's thread; may be used from any thread."""
        self._soon.append(called)
        if self._asleep:
            self._asleep = False
            # A full socket wakes the loop anyway, and a closed one has no loop to wake.
            with contextlib.suppress(OSError):
                self._waker.send(b"\0")

    def aside(self, work: Callable[[], None]) -> None:
        """Do blocking work, such as opening a port, in a separate thread."""
        Thread(target=work, name="drivecomm open", daemon=True).start()

    def run(self, after_round: Callable[[], bool]) -> None:
        """Run the loop. after_round: called after each round; returns True to end the loop."""
        call, soon, timers = self._ears.call_the_readable, self._soon, self._timers
        while True:
            while soon:
                soon.popleft()()
            if timers and timers[0][0] <= _monotonic() + _LEAD_S:
                self._call_those_whose_time_has_come()
            if after_round():
                return
            self._asleep = True
            # Callbacks queued before `_asleep` was set are seen here; later ones wake the selector.
            call(0 if soon else self._longest_sleep_s())
            self._asleep = False

    def close(self) -> None:
        """Close the descriptors of the loop."""
        self._ears.close()
        self._woken.close()
        self._waker.close()
        if self._alarm is not None:
            self._alarm.close()

    def _call_those_whose_time_has_come(self) -> None:
        timers, now, number = self._timers, _monotonic() + _LEAD_S, self._number
        # A timer that is set again for the same time is called in the next round.
        while timers and timers[0][0] <= now and timers[0][1] <= number:
            heapq.heappop(timers)[2]()

    def _longest_sleep_s(self) -> float | None:
        """Return the maximum sleep in seconds; None with a kernel timer, which wakes the loop more precisely."""
        first = self._timers[0][0] if self._timers else float("inf")
        if self._alarm is None:
            return None if first == float("inf") else max(0.0, first - _monotonic())
        if first != self._alarm_at:
            self._alarm_at = first
            if first == float("inf"):
                self._alarm.clear()
            else:
                self._alarm.set(first - _LEAD_S)
        return None

    def _empty_pipe(self) -> None:
        self._woken.recv(4096)


def _nothing() -> None:
    pass


class _Epoll:
    """Watched descriptors on Linux, by epoll: `selectors` takes several times as long for one event."""

    def __init__(self) -> None:
        self._epoll = select.epoll()
        self._called: dict[int, Callable[[], None]] = {}

    def watch(self, descriptor: int, readable: Callable[[], None]) -> None:
        """Call `readable` whenever the descriptor is readable."""
        self._epoll.register(descriptor, select.EPOLLIN)
        self._called[descriptor] = readable

    def unwatch(self, descriptor: int) -> None:
        """Stop watching this descriptor, which may be closed already."""
        del self._called[descriptor]
        with contextlib.suppress(OSError):
            self._epoll.unregister(descriptor)

    def call_the_readable(self, longest_s: float | None) -> None:
        """Wait at most `longest_s` for readable descriptors, and call the function of each."""
        called = self._called
        for descriptor, _ in self._epoll.poll(longest_s):
            # A function called earlier in this round may have stopped watching this descriptor.
            if descriptor in called:
                called[descriptor]()

    def close(self) -> None:
        """Close the epoll descriptor."""
        self._epoll.close()


class _Selector:
    """Watched descriptors on other systems, by the best selector that they have."""

    def __init__(self) -> None:
        self._selector = selectors.DefaultSelector()

    def watch(self, descriptor: int, readable: Callable[[], None]) -> None:
        """Call `readable` whenever the descriptor is readable."""
        self._selector.register(descriptor, selectors.EVENT_READ, readable)

    def unwatch(self, descriptor: int) -> None:
        """Stop watching this descriptor."""
        self._selector.unregister(descriptor)

    def call_the_readable(self, longest_s: float | None) -> None:
        """Wait at most `longest_s` for readable descriptors, and call the function of each."""
        for key, _ in self._selector.select(longest_s):
            if key.fileobj in self._selector.get_map():
                key.data()

    def close(self) -> None:
        """Close the selector."""
        self._selector.close()
