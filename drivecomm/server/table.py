"""The table of a server: current values, recent events, and the listeners for changes.

One thread writes to it. Other threads may read at any time, because they get immutable values.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections import deque
from dataclasses import replace
from itertools import count
from threading import Lock
from typing import TYPE_CHECKING, TypeAlias

from drivecomm.errors import printable
from drivecomm.line import FRESH
from drivecomm.server.observations import Event

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable, Collection, Sequence

    from drivecomm.server.observations import CurrentValue, EventKind

_log = logging.getLogger("drivecomm.server")

KEPT_EVENTS = 1000
"""Number of events in the table; the history has older ones."""

LEAST_S = 1.0
"""Minimum age of a stale value in seconds, whatever its poll period: stops and waits for replies delay polls."""
NOT_ASKED = "was not polled for too long, because its line was busy"

TOGETHER_S, MANY_TOGETHER_S = 0.002, 0.004
"""Collection times of changes for one call of the listeners; longer after many changes, as a call wakes all doors."""
_MANY = 4
"""Number of changes in one call that counts as many; some thousand values a second bring this number."""


class ValueTable:
    """Current values and events. later: calls a function after some seconds, in the table's one thread."""

    def __init__(self, later: Callable[[float, Callable[[], None]], object]) -> None:
        self._later = later
        self._values: dict[tuple[str, str], CurrentValue] = {}
        self._put_s: dict[tuple[str, str], float] = {}
        self._events: deque[Event] = deque(maxlen=KEPT_EVENTS)
        self._numbers = count(1)
        self._new_values: dict[tuple[str, str], CurrentValue] = {}
        self._new_events: list[Event] = []
        self._listeners: tuple[Listener, ...] = ()
        self._listening = Lock()
        self._told_soon = False

    def put_value(self, value: CurrentValue) -> None:
        """Store the latest value of a quantity."""
        key = value.drive, value.name
        self._values[key] = value
        self._put_s[key] = time.monotonic()
        self._new_values[key] = value
        self._tell_soon()

    def grow_old(self) -> Sequence[CurrentValue]:
        """Mark values as stale that were not polled again in time, and return them.

        A line that is busy does not report them itself.
        """
        now = time.monotonic()
        overdue = [
            value
            for key, value in self._values.items()
            if value.quality in FRESH and now - self._put_s[key] > max(value.keeps_s, LEAST_S)
        ]
        for value in overdue:
            self.put_value(replace(value, quality="stale", cause=NOT_ASKED, time_s=time.time()))
        return overdue

    def record_event(
        self, kind: EventKind, text: str, *, drive: str = "", line: str = "", who: str = "", alarm: str = ""
    ) -> Event:
        """Record an event; texts from callers and drives are made printable, so they cannot control a terminal."""
        event = Event(
            number=next(self._numbers),
            time_s=time.time(),
            kind=kind,
            text=printable(text),
            drive=printable(drive),
            line=line,
            who=printable(who),
            alarm=alarm,
        )
        self._events.append(event)
        self._new_events.append(event)
        self._tell_soon()
        return event

    def forget(self, drives: Collection[str], *, why: str = "") -> None:
        """Forget the values of these drives.

        why: reported to listeners as the cause of their bad quality; empty for removed drives, which are not reported.
        """
        gone = [each for each in self._values.values() if each.drive in drives]
        self._values, self._new_values = (
            {key: each for key, each in known.items() if key[0] not in drives}
            for known in (self._values, self._new_values)
        )
        self._put_s = {key: each for key, each in self._put_s.items() if key in self._values}
        if why and gone:
            now = time.time()
            for value in gone:
                bad = replace(value, reading=None, quality="bad", cause=why, time_s=now)
                self._new_values[value.drive, value.name] = bad
            self._tell_soon()

    def values(self) -> Sequence[CurrentValue]:
        """Return all current values."""
        return tuple(self._values.copy().values())

    def value(self, drive: str, name: str) -> CurrentValue | None:
        """Return one current value, or None before the first one."""
        return self._values.get((drive, name))

    def events(self) -> Sequence[Event]:
        """Return the latest events, the oldest first."""
        return tuple(self._events.copy())

    def listen(self, listener: Listener) -> Callable[[], None]:
        """Call a listener with all changes from now on; return a function that removes the listener.

        May be called in any thread.
        """
        with self._listening:
            self._listeners = (*self._listeners, listener)

        def end() -> None:
            with self._listening:
                self._listeners = tuple(each for each in self._listeners if each is not listener)

        return end

    def _tell_soon(self) -> None:
        # The first change after a pause is reported in this round of the event loop, further ones a little later.
        if not self._told_soon:
            self._told_soon = True
            self._later(0.0, self._tell)

    def _tell(self) -> None:
        values, self._new_values = tuple(self._new_values.values()), {}
        events, self._new_events = self._new_events, []
        if not values and not events:
            self._told_soon = False
            return
        for listener in self._listeners:
            try:
                listener(values, events)
            except Exception:  # noqa: BLE001 - the server must not stop for this
                # One failing listener must not cut off the others, nor itself from later changes.
                _log.exception("publishing changes")
        self._later(TOGETHER_S if len(values) < _MANY else MANY_TOGETHER_S, self._tell)


Listener: TypeAlias = "Callable[[Sequence[CurrentValue], Sequence[Event]], None]"
"""A function that is called with the latest values and the events of a short time."""

MOST_EVENTS = 1000
"""Queue limit of events for a slow reader."""


class ChangeSubscription:
    """A subscription of one event loop to changes; made within that loop. every_s: minimum time between batches."""

    def __init__(self, table: ValueTable, every_s: float) -> None:
        self._loop = asyncio.get_running_loop()
        self._every_s = every_s
        self._ready = asyncio.Event()
        self._lock = Lock()
        self._values: dict[tuple[str, str], CurrentValue] = {}
        self._events: deque[Event] = deque(maxlen=MOST_EVENTS)
        self._waited_for = False
        self.lost = 0
        self._end = table.listen(self._told)

    async def __aiter__(self) -> AsyncIterator[tuple[Sequence[CurrentValue], Sequence[Event]]]:
        """Yield each batch of changes, and wait for the next one."""
        while True:
            if batch := self._taken():
                yield batch
                # A reader that is not in a hurry leaves the processor to the lines, and is not woken meanwhile.
                await asyncio.sleep(self._every_s)
            else:
                await self._ready.wait()

    def _taken(self) -> tuple[Sequence[CurrentValue], Sequence[Event]] | None:
        """Return the collected changes; if there are none, return None and let the next change wake the reader."""
        with self._lock:
            if not self._values and not self._events:
                self._ready.clear()
                self._waited_for = True
                return None
            values, self._values = tuple(self._values.values()), {}
            events = tuple(self._events)
            self._events.clear()
            return values, events

    def close(self) -> None:
        """Unsubscribe."""
        self._end()

    def _told(self, values: Sequence[CurrentValue], events: Sequence[Event]) -> None:
        with self._lock:
            for value in values:
                self._values[value.drive, value.name] = value
            self.lost += max(0, len(self._events) + len(events) - MOST_EVENTS)
            self._events.extend(events)
            waited_for, self._waited_for = self._waited_for, False
        if waited_for:
            try:
                self._loop.call_soon_threadsafe(self._ready.set)
            except RuntimeError:
                # The event loop of the reader has ended.
                self._end()
