"""Carrying out a poll plan on many lines: one thread serves all whose ports can be watched."""

from __future__ import annotations

import time
from queue import Empty, SimpleQueue
from threading import Event, Thread
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias, runtime_checkable

from drivecomm.errors import DriveCommError
from drivecomm.line.loop import Engine
from drivecomm.line.poll_items import PollBlock, PollItem, PollResult
from drivecomm.line.polling import NAP_S, D, Polling, poll_bus

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Sequence

_WAITING_BATCHES = 200
"""So many batches of results wait for a slow reader, then the lines wait for it."""

_BATCH_S = 0.01
"""The reader of many results a second is woken no more often than this; it costs as much as an exchange."""

# Written as a union, it would be made anew for every exchange.
_TURNS = (PollItem, PollBlock)

_Results: TypeAlias = "SimpleQueue[list[PollResult] | BaseException | None]"


class EngineLine(Protocol):
    """What carries out jobs on one line among many."""

    def run(self, job: Any, ended: Callable[[Any, Exception | None], None]) -> None:
        """Carry out a job when it is its turn. ended: told its result or its error, maybe before this returns."""

    def rest(self) -> None:
        """Let others have the line until the next job."""

    def close(self) -> None:
        """Cut off what is under way."""


@runtime_checkable
class EngineBus(Protocol):
    """A bus that can share one thread with others."""

    def on_engine(self, engine: Engine) -> EngineLine | None:
        """Return its line for an engine; None where that cannot be."""


def poll_together(
    lines: Sequence[Sequence[PollItem[D]]], duration_s: float, cycles: int | None
) -> Generator[PollResult, None, None]:
    """Yield the results of a plan, given by lines.

    One thread serves all lines. Those whose port the system cannot watch (virtual ones, serial ports of Windows, RFC
    2217) have a thread each.
    """
    results: _Results = SimpleQueue()
    stop = Event()
    engine = Engine()
    served = _Served(engine, results)
    threads = [Thread(target=served.run, name="drivecomm poll", daemon=True)]
    for items in lines:
        bus = items[0].drive.bus
        line = bus.on_engine(engine) if isinstance(bus, EngineBus) else None
        if line is not None:
            served.lines.append(_PolledLine(Polling(items, duration_s, cycles), line, served))
        else:
            arguments = (items, duration_s, cycles, results, stop)
            threads.append(Thread(target=_work, args=arguments, name="drivecomm poll", daemon=True))
    running = len(threads)
    for thread in threads:
        thread.start()
    try:
        while running:
            try:
                # On Windows a wait without an end cannot be interrupted.
                came = results.get(timeout=NAP_S)
            except Empty:
                continue
            if isinstance(came, BaseException):
                raise came
            if came is None:
                running -= 1
            else:
                yield from came
    finally:
        stop.set()
        engine.call_soon(served.stop)
        for thread in threads:
            thread.join()
        engine.close()


def _work(
    items: Sequence[PollItem[Any]], duration_s: float, cycles: int | None, results: _Results, stop: Event
) -> None:
    """Poll one line in a thread of its own."""
    try:
        for result in poll_bus(items, duration_s, cycles, stop.is_set):
            results.put([result])
            while results.qsize() >= _WAITING_BATCHES and not stop.is_set():
                time.sleep(NAP_S)
        results.put(None)
    except BaseException as error:  # noqa: BLE001 - it is raised again where the results are read
        results.put(error)


class _Served:
    """The lines that one engine serves. results: where batches of results go."""

    def __init__(self, engine: Engine, results: _Results) -> None:
        self.engine = engine
        self.lines: list[_PolledLine] = []
        self.stopped = False
        self.begins_nothing = False
        """Whether the lines look what holds them up: the plan was given up, or its reader is slow."""
        self._results = results
        self._batch: list[PollResult] = []
        self.give = self._batch.append
        """Takes a result; the reader gets it together with others."""
        self._next_batch_at = 0.0
        self._woken = False
        self._over = 0

    def run(self) -> None:
        """Poll until all lines are at the end of their plan."""
        try:
            for line in self.lines:
                line.go_on()
            self.engine.run(self._end_round)
            self._results.put(self._batch)
            self._results.put(None)
        except BaseException as error:  # noqa: BLE001 - it is raised again where the results are read
            self._results.put(error)
        finally:
            for line in self.lines:
                line.close()

    def stop(self) -> None:
        """Begin nothing any more; what is under way is brought to its end."""
        self.stopped = self.begins_nothing = True
        for line in self.lines:
            line.wake()

    def reader_is_slow(self) -> bool:
        """Whether the lines wait until the reader has taken more of the results."""
        slow = self._results.qsize() >= _WAITING_BATCHES
        self.begins_nothing = slow or self.stopped
        return slow

    def is_over(self) -> None:
        """Take note that a line is at the end of its plan."""
        self._over += 1

    def _end_round(self) -> bool:
        """Hand over the results; return whether all lines are at the end."""
        if self._batch:
            self._hand_over()
        return self._over == len(self.lines)

    def _hand_over(self) -> None:
        now = self.engine.now()
        if now >= self._next_batch_at:
            self._results.put(self._batch.copy())
            self._batch.clear()
            self._next_batch_at = now + _BATCH_S
            self.reader_is_slow()
        elif not self._woken:
            self._woken = True
            self.engine.call_at(self._next_batch_at, self._wake)

    def _wake(self) -> None:
        self._woken = False


class _PolledLine:
    """Polls one line: whenever nothing is under way on it, it does what is due."""

    def __init__(self, polling: Polling[Any], line: EngineLine, served: _Served) -> None:
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
        """Do what is due, until something must be waited for."""
        if self._at_it:
            # What has come is seen by the loop below: however often there is nothing to wait for, it gets no deeper.
            return
        self._at_it = True
        try:
            while self._item is None and not self._asleep and not self._over:
                if self._served.begins_nothing:
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
        """Sleep no longer."""
        if self._asleep:
            self._asleep = False
            self.go_on()

    def close(self) -> None:
        """Let go of the line."""
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
        # The plan keeps its items, so that no other object can come to have the identity of one.
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
            # A bus that has been closed ends the plan.
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
        """Begin nothing, since the plan is given up or its reader has enough to do."""
        if self._served.stopped:
            self._end()
        elif self._served.reader_is_slow():
            self._sleep_until(self._now() + NAP_S)

    def _end(self) -> None:
        self._line.rest()
        self._over = True
        self._served.is_over()

    def _sleep_until(self, until: float) -> None:
        self._line.rest()
        self._asleep = True
        self._served.engine.call_at(until, self.wake)
