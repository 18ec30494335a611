"""Many lines in one thread: one selector for their ports, one alarm for their pauses."""

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

from drivecomm.transport import open_alarm

if TYPE_CHECKING:
    from collections.abc import Callable

# About what passes between an alarm and its being heard.
_LEAD_S = 25e-6

_monotonic = time.monotonic


class Engine:
    """Calls those whose descriptor is readable or whose time has come, in the thread that is in `run`.

    Nobody who is called may wait: what must is done `aside`. Only `call_soon` may be used from other threads.
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
        self._alarm = open_alarm()
        self._alarm_at = float("inf")
        if self._alarm is not None:
            self._ears.watch(self._alarm.descriptor, _nothing)

    # The monotonic clock, in seconds; not a method of its own, which would cost as much again.
    now = staticmethod(_monotonic)

    def watch(self, descriptor: int, readable: Callable[[], None]) -> None:
        """Call this whenever a descriptor is readable."""
        self._ears.watch(descriptor, readable)

    def unwatch(self, descriptor: int) -> None:
        """Do not call for this descriptor any more."""
        self._ears.unwatch(descriptor)

    def call_at(self, when: float, timed: Callable[[], None]) -> None:
        """Call this at a time of the monotonic clock, or a fraction of a millisecond before it."""
        self._number += 1
        heapq.heappush(self._timers, (when, self._number, timed))

    def call_soon(self, called: Callable[[], None]) -> None:
        """Call this in the engine's thread; may be used from any thread."""
        self._soon.append(called)
        if self._asleep:
            self._asleep = False
            # One that takes no more wakes us all the same, and one that is closed has nobody to wake.
            with contextlib.suppress(OSError):
                self._waker.send(b"\0")

    def aside(self, work: Callable[[], None]) -> None:
        """Do in a thread of its own what may take long, such as opening a port."""
        Thread(target=work, name="drivecomm open", daemon=True).start()

    def run(self, after_round: Callable[[], bool]) -> None:
        """Call those that are to be called. after_round: called after each round, returns whether it was the last."""
        call, soon, timers = self._ears.call_the_readable, self._soon, self._timers
        while True:
            while soon:
                soon.popleft()()
            if timers and timers[0][0] <= _monotonic() + _LEAD_S:
                self._call_those_whose_time_has_come()
            if after_round():
                return
            self._asleep = True
            # Whoever came before this was said is seen here, and whoever comes after it wakes us.
            call(0 if soon else self._longest_sleep_s())
            self._asleep = False

    def close(self) -> None:
        """Give the descriptors back."""
        self._ears.close()
        self._woken.close()
        self._waker.close()
        if self._alarm is not None:
            self._alarm.close()

    def _call_those_whose_time_has_come(self) -> None:
        timers, now, number = self._timers, _monotonic() + _LEAD_S, self._number
        # Who asks for the same time again is called in the next round.
        while timers and timers[0][0] <= now and timers[0][1] <= number:
            heapq.heappop(timers)[2]()

    def _longest_sleep_s(self) -> float | None:
        """Return how long to sleep at most; where there is an alarm, that wakes us, and more exactly."""
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
    """Who is called for which descriptor, with Linux' own means: `selectors` takes several times as long for one."""

    def __init__(self) -> None:
        self._epoll = select.epoll()
        self._called: dict[int, Callable[[], None]] = {}

    def watch(self, descriptor: int, readable: Callable[[], None]) -> None:
        """Call this whenever a descriptor is readable."""
        self._epoll.register(descriptor, select.EPOLLIN)
        self._called[descriptor] = readable

    def unwatch(self, descriptor: int) -> None:
        """Do not call for this descriptor any more; it may be closed already."""
        del self._called[descriptor]
        with contextlib.suppress(OSError):
            self._epoll.unregister(descriptor)

    def call_the_readable(self, longest_s: float | None) -> None:
        """Wait until descriptors are readable, at most so long, and call for each."""
        called = self._called
        for descriptor, _ in self._epoll.poll(longest_s):
            # Who was called before it may have taken it away.
            if descriptor in called:
                called[descriptor]()

    def close(self) -> None:
        """Give the descriptor back."""
        self._epoll.close()


class _Selector:
    """The same with the best that another system has."""

    def __init__(self) -> None:
        self._selector = selectors.DefaultSelector()

    def watch(self, descriptor: int, readable: Callable[[], None]) -> None:
        """Call this whenever a descriptor is readable."""
        self._selector.register(descriptor, selectors.EVENT_READ, readable)

    def unwatch(self, descriptor: int) -> None:
        """Do not call for this descriptor any more."""
        self._selector.unregister(descriptor)

    def call_the_readable(self, longest_s: float | None) -> None:
        """Wait until descriptors are readable, at most so long, and call for each."""
        for key, _ in self._selector.select(longest_s):
            if key.fileobj in self._selector.get_map():
                key.data()

    def close(self) -> None:
        """Give the descriptors back."""
        self._selector.close()
