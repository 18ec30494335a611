"""Delivery of messages: a thread for each receiver, which retries until a message has arrived, or for an hour.

Each message is delivered at least once: a receiver that confirms it too late gets it again, with the same id. Alarms
within a second go out as one message, and so do those that have waited for a receiver that could not be reached.
"""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass
from threading import Condition, Thread
from typing import TYPE_CHECKING, Any

from drivecomm.server.alarms.messages import message_of
from drivecomm.server.alarms.receivers import WITHIN_S

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from drivecomm.server.alarms.receivers import AlarmReceiver

MOST = 1000
"""Queue limit of a receiver; beyond it the oldest entries are dropped."""


@dataclass(frozen=True, slots=True, kw_only=True)
class UndeliveredAlarm:
    """An undelivered alarm for one receiver. to: its entry in the plant file. entry: one of the alarms of a message."""

    to: str
    entry: Mapping[str, Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class DeliveryTiming:
    """The timing of deliveries, in seconds.

    within_s: time limit of one attempt. first_s, longest_s: the pause after a failure doubles from the first to the
    second. give_up_s: time for which a message is retried. gather_s: alarms within this time go out as one message.
    """

    within_s: float = WITHIN_S
    first_s: float = 1.0
    longest_s: float = 60.0
    give_up_s: float = 3600.0
    gather_s: float = 1.0


class AlarmDelivery:
    """Delivery of alarms to receivers, with a thread for each of them.

    receivers: by their entry in the plant file. plant: its name. say: called from these threads with a sentence when a
    delivery fails, and when it succeeds after failures. changed: called from these threads when a queue has become
    shorter.
    """

    def __init__(
        self,
        receivers: Mapping[str, AlarmReceiver],
        *,
        plant: str,
        say: Callable[[str], None],
        changed: Callable[[], None] = lambda: None,
        pace: DeliveryTiming | None = None,
    ) -> None:
        pace = pace or DeliveryTiming()
        self._queues = {entry: _Queue(one, plant, say, changed, pace) for entry, one in receivers.items()}

    def start(self) -> None:
        """Start the delivery threads."""
        for each in self._queues.values():
            each.start()

    def put(self, waiting: Iterable[UndeliveredAlarm]) -> None:
        """Queue alarms for delivery; never waits."""
        for each in waiting:
            if queue := self._queues.get(each.to):
                queue.put(each)

    def waiting(self) -> Sequence[UndeliveredAlarm]:
        """Return all undelivered alarms."""
        return [each for queue in self._queues.values() for each in queue.waiting()]

    def close(self, within_s: float = 2.0) -> None:
        """Try once more to deliver all queued alarms, to all receivers in parallel, within this time."""
        until = time.monotonic() + within_s
        for each in self._queues.values():
            each.close(until)
        for each in self._queues.values():
            each.join(until)


class _Queue:
    """The queue of one receiver, and the thread that delivers its alarms."""

    def __init__(
        self,
        receiver: AlarmReceiver,
        plant: str,
        say: Callable[[str], None],
        changed: Callable[[], None],
        pace: DeliveryTiming,
    ) -> None:
        self._receiver = receiver
        self._plant = plant
        self._say = say
        self._changed = changed
        self._pace = pace
        self._waiting: deque[tuple[float, UndeliveredAlarm]] = deque()
        self._news = Condition()
        self._closing_until: float | None = None
        self._failures = 0
        self._full = False
        # A hung delivery blocks nothing, not even shutdown.
        self._thread = Thread(target=self._run, name=f"alarms to {receiver.label}", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def put(self, waiting: UndeliveredAlarm) -> None:
        with self._news:
            self._waiting.append((time.monotonic(), waiting))
            if full := len(self._waiting) > MOST:
                self._waiting.popleft()
            news, self._full = full and not self._full, self._full or full
            self._news.notify()
        if news:
            self._say(f"more than {MOST} alarms wait for {self._receiver.label}; the oldest are discarded")

    def waiting(self) -> list[UndeliveredAlarm]:
        with self._news:
            return [each for _, each in self._waiting]

    def close(self, until: float) -> None:
        with self._news:
            self._closing_until = until
            self._news.notify()

    def join(self, until: float) -> None:
        if self._thread.is_alive():
            self._thread.join(max(0.0, until - time.monotonic()))

    def _run(self) -> None:
        if problem := self._receiver.problem():
            self._say(f"no alarm can be delivered to {self._receiver.label}: {problem}")
        while True:
            with self._news:
                self._news.wait_for(lambda: self._waiting or self._closing_until is not None)
                self._news.wait_for(lambda: self._closing_until is not None, self._pace.gather_s)
                now, closing = [*self._waiting], self._closing_until
            if not now:
                return
            left_s = self._pace.within_s if closing is None else closing - time.monotonic()
            if left_s <= 0:
                return
            self._try(now, min(left_s, self._pace.within_s))
            if closing is not None:
                return

    def _try(self, now: Sequence[tuple[float, UndeliveredAlarm]], within_s: float) -> None:
        failure = self._receiver.deliver(message_of(self._plant, [each.entry for _, each in now]), within_s)
        if not failure:
            if self._failures:
                self._say(f"alarms were delivered to {self._receiver.label}, after {self._failures + 1} tries")
            self._failures = 0
            self._done(now)
            return
        self._failures += 1
        if self._failures == 1:
            self._say(f"an alarm could not be delivered to {self._receiver.label}, and will be retried: {failure}")
        until = time.monotonic() - self._pace.give_up_s
        if too_old := [each for each in now if each[0] <= until]:
            self._say(f"an alarm was not delivered to {self._receiver.label}, and is discarded: {failure}")
            self._done(too_old)
        pause_s = min(self._pace.longest_s, self._pace.first_s * 2 ** min(self._failures - 1, 20))
        with self._news:
            self._news.wait_for(lambda: self._closing_until is not None, pause_s)

    def _done(self, done: Sequence[tuple[float, UndeliveredAlarm]]) -> None:
        with self._news:
            gone = {id(each) for each in done}
            self._waiting = deque(each for each in self._waiting if id(each) not in gone)
            self._full = len(self._waiting) >= MOST
        self._changed()
