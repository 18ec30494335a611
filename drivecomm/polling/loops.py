"""Carrying out poll plans: on one bus, on several with a thread for each, and the same over asyncio.

The schedule decides whose turn it is; the loops here only wait, read, and hand over results.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar

from drivecomm.errors import DriveCommError, LinkError, UsageError, shortened
from drivecomm.link import REOPEN_FIRST_S, Backoff
from drivecomm.polling.schedule import PollItem, PollResult, Schedule, checked
from drivecomm.protocol import is_duration

if TYPE_CHECKING:
    from asyncio import Queue as AsyncQueue
    from collections.abc import AsyncGenerator, Callable, Generator, Iterable, Sequence
    from queue import Queue
    from threading import Event

    from drivecomm.protocol import Reading

_NAP_S = 0.1
"""The longest sleep in one piece: a plan that is given up ends within this time."""

_WAITING_RESULTS = 1000
"""So many results wait for a slow reader, then the lines wait for it."""


class PolledBus(Protocol):
    """What a poll loop needs of a bus, be it a `Bus` or an `AsyncBus`."""

    def now(self) -> float:
        """Return the time of the bus's clock, in seconds; also while its line is down. UsageError when closed."""

    def wall_time(self) -> float:
        """Return the time in seconds since 1970; on a virtual line since its start."""

    def sleep_until(self, until: float) -> Any:
        """Wait outside the line's turn, also while it is down."""


class PolledDrive(Protocol):
    """What a poll loop needs of a drive, be it a `Drive` or an `AsyncDrive`."""

    @property
    def name(self) -> str:
        """The drive as the command line names it."""

    @property
    def bus(self) -> PolledBus:
        """The bus that it is on."""

    def check_read(self, parameter: str, **options: Any) -> None:
        """Raise UsageError for a parameter that can never be read."""

    def polled(self, parameter: str, **options: Any) -> Any:
        """Read a parameter, letting everything else on the bus go first."""


D = TypeVar("D", bound=PolledDrive)


def poll(
    items: Iterable[PollItem[D]], *, duration_s: float | None = None, cycles: int | None = None
) -> Generator[PollResult, None, None]:
    """Yield the results of a plan in the order in which they come, from as many buses as its drives are on.

    Ends when each item has had `cycles` results, or after `duration_s` on each bus's clock; with neither it goes on
    until it is closed. Whatever fails is a result of its item and never ends the plan; a line that is down is tried
    again every half second. Each bus has a thread of its own when there are several. Raises UsageError for a plan that
    cannot be carried out or that has what can never be read, and when a bus has been closed.
    """
    lines, end_s = _by_bus(readable(checked(items, cycles=cycles))), _seconds(duration_s)
    return poll_bus(lines[0], end_s, cycles) if len(lines) == 1 else _poll_buses(lines, end_s, cycles)


def poll_async(
    items: Iterable[PollItem[D]], *, duration_s: float | None = None, cycles: int | None = None
) -> AsyncGenerator[PollResult, None]:
    """Do the same as `poll` with asynchronous drives, on one event loop."""
    lines, end_s = _by_bus(readable(checked(items, cycles=cycles))), _seconds(duration_s)
    return _poll_bus_async(lines[0], end_s, cycles) if len(lines) == 1 else _poll_buses_async(lines, end_s, cycles)


def readable(items: Sequence[PollItem[D]]) -> Sequence[PollItem[D]]:
    """Return these items. Raises UsageError that names all of them that can never be read, each with its reason."""
    refused = []
    for item in items:
        try:
            item.drive.check_read(item.parameter, **item.options)
        except UsageError as error:
            refused.append(f"{item.name or item.drive.name} {item.parameter} ({' '.join(str(error).split())})")
    if refused:
        raise UsageError(f"the plan has what can never be read, take it out: {', '.join(refused)}")
    return items


class _Polling(Generic[D]):
    """The poll loop of one line without its waiting and reading: what comes next, and what came of it."""

    def __init__(self, items: Sequence[PollItem[D]], duration_s: float, cycles: int | None) -> None:
        self.bus = items[0].drive.bus
        self._start_s = self.bus.now()
        self._duration_s = duration_s
        self._schedule = Schedule(items, start_s=self._start_s, cycles=cycles)
        self._backoff = Backoff(REOPEN_FIRST_S, REOPEN_FIRST_S)
        self._down: LinkError | None = None

    def next(self) -> PollItem[D] | PollResult | float | None:
        """Return the item to read, or the time until which none is due; None when the plan is over.

        While the line is down, an item is not worth trying and its result is returned instead.
        """
        now, due_s = self.bus.now(), self._schedule.next_due()
        if due_s == math.inf or max(now, due_s) - self._start_s >= self._duration_s:
            return None
        item = self._schedule.due(now)
        if item is None:
            return due_s
        if self._down is not None and now < self._backoff.over_at:
            return self._result(item, self._down)
        return item

    def finished(self, item: PollItem[D], outcome: Reading | DriveCommError) -> PollResult:
        """Return the result of an item that was read."""
        if isinstance(outcome, LinkError):
            self._down = outcome
            self._backoff.failed(self.bus.now())
        return self._result(item, outcome)

    def _result(self, item: PollItem[D], outcome: Reading | DriveCommError) -> PollResult:
        return self._schedule.finished(item, self.bus.now(), outcome, time_s=self.bus.wall_time())


def _never() -> bool:
    return False


def poll_bus(
    items: Sequence[PollItem[D]], duration_s: float, cycles: int | None = None, stopped: Callable[[], bool] = _never
) -> Generator[PollResult, None, None]:
    """Yield the results of items that are all on one bus; what can never be read is a failure each time."""
    polling = _Polling(items, duration_s, cycles)
    while not stopped() and (due := polling.next()) is not None:
        if isinstance(due, PollItem):
            outcome: Reading | DriveCommError
            try:
                outcome = due.drive.polled(due.parameter, **due.options)
            except DriveCommError as error:
                outcome = error
            yield polling.finished(due, outcome)
        elif isinstance(due, PollResult):
            yield due
        else:
            polling.bus.sleep_until(min(due, polling.bus.now() + _NAP_S))


async def _poll_bus_async(
    items: Sequence[PollItem[D]], duration_s: float, cycles: int | None
) -> AsyncGenerator[PollResult, None]:
    polling = _Polling(items, duration_s, cycles)
    while (due := polling.next()) is not None:
        if isinstance(due, PollItem):
            outcome: Reading | DriveCommError
            try:
                outcome = await due.drive.polled(due.parameter, **due.options)
            except DriveCommError as error:
                outcome = error
            yield polling.finished(due, outcome)
        elif isinstance(due, PollResult):
            yield due
        else:
            await polling.bus.sleep_until(due)


def _poll_buses(
    lines: Sequence[Sequence[PollItem[D]]], duration_s: float, cycles: int | None
) -> Generator[PollResult, None, None]:
    # Plans on one line, the usual ones, need no threads.
    from queue import Empty, Queue  # noqa: PLC0415
    from threading import Event, Thread  # noqa: PLC0415

    results: Queue[PollResult | BaseException | None] = Queue(_WAITING_RESULTS)
    stop = Event()

    def work(items: Sequence[PollItem[D]]) -> None:
        try:
            for result in poll_bus(items, duration_s, cycles, stop.is_set):
                _hand_over(results, result, stop)
            _hand_over(results, None, stop)
        except BaseException as error:  # noqa: BLE001 - it is raised again where the results are read
            _hand_over(results, error, stop)

    threads = [Thread(target=work, args=(items,), name="drivecomm poll", daemon=True) for items in lines]
    running = len(threads)
    for thread in threads:
        thread.start()
    try:
        while running:
            try:
                # On Windows a wait without an end cannot be interrupted.
                result = results.get(timeout=_NAP_S)
            except Empty:
                continue
            if isinstance(result, BaseException):
                raise result
            if result is None:
                running -= 1
            else:
                yield result
    finally:
        stop.set()
        for thread in threads:
            thread.join()


def _hand_over(
    results: Queue[PollResult | BaseException | None], result: PollResult | BaseException | None, stop: Event
) -> None:
    from queue import Full  # noqa: PLC0415 - as above

    while not stop.is_set():
        try:
            results.put(result, timeout=_NAP_S)
        except Full:
            continue
        return


async def _poll_buses_async(
    lines: Sequence[Sequence[PollItem[D]]], duration_s: float, cycles: int | None
) -> AsyncGenerator[PollResult, None]:
    import asyncio  # noqa: PLC0415 - for those who have an event loop already

    results: AsyncQueue[PollResult | BaseException | None] = asyncio.Queue(_WAITING_RESULTS)

    async def work(items: Sequence[PollItem[D]]) -> None:
        try:
            async for result in _poll_bus_async(items, duration_s, cycles):
                await results.put(result)
            await results.put(None)
        except Exception as error:  # noqa: BLE001 - it is raised again where the results are read
            await results.put(error)

    tasks = [asyncio.create_task(work(items)) for items in lines]
    running = len(tasks)
    try:
        while running:
            result = await results.get()
            if isinstance(result, BaseException):
                raise result
            if result is None:
                running -= 1
            else:
                yield result
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


def _by_bus(items: Sequence[PollItem[D]]) -> list[list[PollItem[D]]]:
    lines: dict[int, list[PollItem[D]]] = {}
    for item in items:
        lines.setdefault(id(item.drive.bus), []).append(item)
    return list(lines.values())


def _seconds(duration_s: float | None) -> float:
    if duration_s is None:
        return math.inf
    if duration_s != math.inf and not (is_duration(duration_s) and duration_s > 0):
        raise UsageError(f"a poll duration cannot be {shortened(duration_s)} s; give seconds above 0")
    return duration_s
