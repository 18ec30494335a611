"""Execution of a poll plan on many lines: one thread serves all lines whose ports can be watched."""

from __future__ import annotations

import time
from threading import Event, Thread
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

from drivecomm.errors import DriveCommError
from drivecomm.line.delivery import NAP_S, ResultDelivery
from drivecomm.line.line_engine import Engine
from drivecomm.line.poll_items import PollBlock, PollItem, PollResult
from drivecomm.line.poll_loops import poll_bus
from drivecomm.line.polling import D, Polling

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Sequence

    from drivecomm.line.engine_line import EngineLine

_BATCH_S = 0.01
"""Minimum time in seconds between two wake-ups of the reader, because each costs as much as an exchange."""

# A tuple, because a union would be built anew for every exchange.
_TURNS = (PollItem, PollBlock)


@runtime_checkable
class EngineBus(Protocol):
    """A bus that can share one thread with others."""

    def on_engine(self, engine: Engine) -> EngineLine | None:
        """Return the line of this bus for an engine; None if its port cannot be watched."""


def poll_together(
    lines: Sequence[Sequence[PollItem[D]]], duration_s: float, cycles: int | None
) -> Generator[PollResult, None, None]:
    """Yield the results of a plan whose items are grouped by line.

    One thread serves all lines, except those whose port the system cannot watch (virtual ones, serial ports of Windows,
    RFC 2217): each of these has its own thread.
    """
    came = Event()
    delivery = ResultDelivery(came.set)
    engine = Engine()
    served = _EngineLines(engine, delivery)
    threads = [Thread(target=served.run, name="drivecomm poll", daemon=True)]
    for items in lines:
        bus = items[0].drive.bus
        line = bus.on_engine(engine) if isinstance(bus, EngineBus) else None
        if line is not None:
            served.lines.append(_PolledLine(Polling(items, duration_s, cycles), line, served))
        else:
            arguments = (items, duration_s, cycles, delivery)
            threads.append(Thread(target=_work, args=arguments, name="drivecomm poll", daemon=True))
    delivery.left = len(threads)
    for thread in threads:
        thread.start()
    try:
        while delivery.left:
            # On Windows a wait without a timeout cannot be interrupted.
            came.wait(NAP_S)
            came.clear()
            yield from delivery.read()
    finally:
        delivery.stopped = True
        engine.call_soon(served.stop)
        for thread in threads:
            thread.join()
        engine.close()


def _work(items: Sequence[PollItem[Any]], duration_s: float, cycles: int | None, delivery: ResultDelivery) -> None:
    """Poll one line in its own thread."""
    try:
        for result in poll_bus(items, duration_s, cycles, lambda: delivery.stopped):
            delivery.give(result)
            while nap_s := delivery.nap_s():
                time.sleep(nap_s)
        delivery.end()
    except BaseException as error:  # noqa: BLE001 - raised again where the results are read
        delivery.end(error)


class _EngineLines:
    """The lines that one engine serves."""

    def __init__(self, engine: Engine, delivery: ResultDelivery) -> None:
        self.engine = engine
        self.lines: list[_PolledLine] = []
        self.delivery = delivery
        self._batch: list[PollResult] = []
        self.give = self._batch.append
        """Adds a result to the batch, which the reader gets as a whole."""
        self.holds_up = False
        """Whether the lines must pause or end: the plan was cancelled, or its reader is slow."""
        self._next_batch_at = 0.0
        self._woken = False
        self._over = 0

    def run(self) -> None:
        """Poll until all lines have completed their plan."""
        try:
            for line in self.lines:
                line.go_on()
            self.engine.run(self._end_round)
            self.delivery.waiting.extend(self._batch)
            self.delivery.end()
        except BaseException as error:  # noqa: BLE001 - raised again where the results are read
            self.delivery.end(error)
        finally:
            for line in self.lines:
                line.close()

    def stop(self) -> None:
        """Begin no further reads; those under way are completed."""
        self.holds_up = True
        for line in self.lines:
            line.wake()

    def nap_s(self) -> float:
        """Return the time in seconds that the lines wait for a slow reader; 0 if they may continue."""
        nap_s = self.delivery.nap_s()
        self.holds_up = self.delivery.stopped or nap_s > 0
        return nap_s

    def is_over(self) -> None:
        """Count a line that has completed its plan."""
        self._over += 1

    def _end_round(self) -> bool:
        """Hand over the results; return whether all lines have completed their plan."""
        if self._batch:
            self._hand_over()
        return self._over == len(self.lines)

    def _hand_over(self) -> None:
        now = self.engine.now()
        if now >= self._next_batch_at:
            self.delivery.waiting.extend(self._batch)
            self._batch.clear()
            self._next_batch_at = now + _BATCH_S
            self.delivery.ring()
            self.nap_s()
        elif not self._woken:
            self._woken = True
            self.engine.call_at(self._next_batch_at, self._wake)

    def _wake(self) -> None:
        self._woken = False


class _PolledLine:
    """Polling of one line: starts the next due read whenever none is under way."""

    def __init__(self, polling: Polling[Any], line: EngineLine, served: _EngineLines) -> None:
        self._polling = polling
        self._line = line
        self._served = served
        self._now = served.engine.now
        self._give = served.give
        self._item: PollItem[Any] | PollBlock[Any] | None = None
        self._pollers: dict[int, Callable[[], Any]] = {}
        self._asleep = False
        self._over = False
        self._at_it = False

    def go_on(self) -> None:
        """Do what is due, until a reply or a time must be awaited."""
        if self._at_it:
            # The loop below sees the new result, so immediate results do not recurse ever deeper.
            return
        self._at_it = True
        try:
            while self._item is None and not self._asleep and not self._over:
                if self._served.holds_up:
                    self._hold_up()
                    continue
                due = self._polling.next(self._now())
                if isinstance(due, _TURNS):
                    self._read(due)
                elif isinstance(due, list):
                    for result in due:
                        self._give(result)
                elif due is None:
                    self._end()
                else:
                    self._sleep_until(due)
        finally:
            self._at_it = False

    def wake(self) -> None:
        """End the sleep and continue."""
        if self._asleep:
            self._asleep = False
            self.go_on()

    def close(self) -> None:
        """Abort the current read and give back the line."""
        self._line.close()

    def _read(self, item: PollItem[Any] | PollBlock[Any]) -> None:
        self._item = item
        try:
            if isinstance(item, PollBlock):
                job = item.drive.to_poll_many(item.parameters)
            else:
                job = (self._pollers.get(id(item)) or self._poller(item))()
        except DriveCommError as error:
            self._ended(None, error)
        else:
            self._line.run(job, self._ended)

    def _poller(self, item: PollItem[Any]) -> Callable[[], Any]:
        # The plan keeps its items, so that no other object can get the identity of one.
        made: Callable[[], Any] = item.drive.poller(item.parameter, item.options)
        self._pollers[id(item)] = made
        return made

    def _ended(self, result: Any, error: Exception | None) -> None:
        item, self._item = self._item, None
        if item is None:
            return
        if error is None:
            outcome, now = result, self._now()
        elif isinstance(error, DriveCommError):
            # Raises if the bus was closed, which ends the plan.
            outcome, now = error, self._polling.bus.now()
        else:
            raise error
        if error is None and isinstance(item, PollItem):
            self._give(self._polling.succeeded(item, now, outcome))
        else:
            for each in self._polling.finished(item, outcome, now):
                self._give(each)
        self.go_on()

    def _hold_up(self) -> None:
        """Begin nothing: end a cancelled plan, or sleep while the reader is slow."""
        if self._served.delivery.stopped:
            self._end()
        elif nap_s := self._served.nap_s():
            self._sleep_until(self._now() + nap_s)

    def _end(self) -> None:
        self._line.rest()
        self._over = True
        self._served.is_over()

    def _sleep_until(self, until: float) -> None:
        self._line.rest()
        self._asleep = True
        self._served.engine.call_at(until, self.wake)
