"""Carrying out poll plans: on one bus, on several with a thread for each, and the same over asyncio.

Whose turn it is decides the schedule; the loops here only wait, ask, and hand over results.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from drivecomm.errors import DriveCommError, LinkError, UsageError, shortened
from drivecomm.polling.schedule import Schedule, checked
from drivecomm.protocol import is_duration

if TYPE_CHECKING:
    from asyncio import Queue as AsyncQueue
    from collections.abc import AsyncGenerator, Callable, Generator, Iterable, Sequence
    from queue import Queue
    from threading import Event

    from drivecomm.polling.schedule import PollItem, PollResult
    from drivecomm.protocol import Reading

_NAP_S = 0.1
"""The longest sleep in one piece: a plan that is given up ends within this time."""

_REOPENING_S = 0.5
"""A line that is down is not tried more often."""

_WAITING_RESULTS = 1000
"""So many results wait for a slow reader, then the lines wait for it."""


class Clock(Protocol):
    """What both kinds of bus have: a clock for waiting, which is virtual on a virtual line, and one for people."""

    def now(self) -> float:
        """Return the time of the bus's clock, in seconds; also while its line is down. UsageError when closed."""
        ...

    def wall_time(self) -> float:
        """Return the time for people."""
        ...


class PolledBus(Clock, Protocol):
    """What the loop needs of a bus."""

    def sleep_until(self, until: float) -> None:
        """Wait outside the line's turn, also while it is down."""
        ...


class PolledDrive(Protocol):
    """What the loop needs of a drive."""

    @property
    def name(self) -> str:
        """The drive as the command line names it."""
        ...

    @property
    def bus(self) -> PolledBus:
        """The bus that it is on."""
        ...

    def check_read(self, parameter: str, **options: Any) -> None:
        """Raise UsageError for a parameter that can never be read."""
        ...

    def polled(self, parameter: str, **options: Any) -> Reading:
        """Read a parameter, letting everything else on the bus go first."""
        ...


class AsyncPolledBus(Clock, Protocol):
    """What the asynchronous loop needs of a bus."""

    async def sleep_until(self, until: float) -> None:
        """Wait outside the line's turn, also while it is down."""
        ...


class AsyncPolledDrive(Protocol):
    """What the asynchronous loop needs of a drive."""

    @property
    def name(self) -> str:
        """The drive as the command line names it."""
        ...

    @property
    def bus(self) -> AsyncPolledBus:
        """The bus that it is on."""
        ...

    def check_read(self, parameter: str, **options: Any) -> None:
        """Raise UsageError for a parameter that can never be read."""
        ...

    async def polled(self, parameter: str, **options: Any) -> Reading:
        """Read a parameter, letting everything else on the bus go first."""
        ...


class _OnABus(Protocol):
    @property
    def name(self) -> str: ...

    @property
    def bus(self) -> Clock: ...

    def check_read(self, parameter: str, **options: Any) -> None: ...


D = TypeVar("D", bound=_OnABus)
S = TypeVar("S", bound=PolledDrive)
A = TypeVar("A", bound=AsyncPolledDrive)


class _DeadLine:
    """Remembers that a line is down, so that not every item tries it again."""

    def __init__(self) -> None:
        self._error: LinkError | None = None
        self._until = -math.inf

    def error(self, now: float) -> LinkError | None:
        """Return why it is not worth trying yet."""
        return self._error if now < self._until else None

    def note(self, now: float, error: DriveCommError) -> None:
        """Take an error; only those of the line count."""
        if isinstance(error, LinkError):
            self._error, self._until = error, now + _REOPENING_S


def poll(
    items: Iterable[PollItem[S]], *, duration_s: float | None = None, cycles: int | None = None
) -> Generator[PollResult, None, None]:
    """Yield the results of a plan in the order in which they come, from as many buses as its drives are on.

    Ends when each item has had `cycles` results, or after `duration_s` on each bus's clock; with neither it goes on
    until it is closed. Whatever fails is a result of its item and never ends the plan; a line that is down is tried
    again every half second. Each bus has a thread of its own when there are several. Raises UsageError for a plan that
    cannot be carried out or that has what can never be read, and when a bus has been closed.
    """
    lines = _by_bus(readable(checked(items, cycles=cycles)))
    end_s = _seconds(duration_s)
    if len(lines) == 1:
        return poll_bus(lines[0], end_s, cycles)
    return _poll_buses(lines, end_s, cycles)


def poll_async(
    items: Iterable[PollItem[A]], *, duration_s: float | None = None, cycles: int | None = None
) -> AsyncGenerator[PollResult, None]:
    """Do the same as `poll` with asynchronous drives, on one event loop."""
    lines = _by_bus(readable(checked(items, cycles=cycles)))
    end_s = _seconds(duration_s)
    if len(lines) == 1:
        return _poll_bus_async(lines[0], end_s, cycles)
    return _poll_buses_async(lines, end_s, cycles)


def readable(items: Sequence[PollItem[D]]) -> Sequence[PollItem[D]]:
    """Return these items. Raises UsageError that names all of them that can never be read, each with its reason."""
    refused = []
    for item in items:
        try:
            item.drive.check_read(item.parameter, **item.options)
        except UsageError as error:
            refused.append(f"{item.name or item.drive.name} {item.parameter} ({' '.join(str(error).split())})")
    if refused:
        raise UsageError(f"what can never be read is not polled, take it out of the plan: {', '.join(refused)}")
    return items


def _never() -> bool:
    return False


def poll_bus(
    items: Sequence[PollItem[S]], duration_s: float, cycles: int | None = None, stopped: Callable[[], bool] = _never
) -> Generator[PollResult, None, None]:
    """Yield the results of items that are all on one bus; what can never be read is a failure each time."""
    bus = items[0].drive.bus
    start = bus.now()
    schedule = Schedule(items, start_s=start, cycles=cycles)
    line = _DeadLine()
    while not stopped():
        now, due_s = bus.now(), schedule.next_due()
        if due_s == math.inf or max(now, due_s) - start >= duration_s:
            return
        item = schedule.due(now)
        if item is None:
            bus.sleep_until(min(due_s, now + _NAP_S))
            continue
        outcome: Reading | DriveCommError | None = line.error(now)
        if outcome is None:
            try:
                outcome = item.drive.polled(item.parameter, **item.options)
            except DriveCommError as error:
                outcome = error
                line.note(bus.now(), error)
        yield schedule.finished(item, bus.now(), outcome, time_s=bus.wall_time())


async def _poll_bus_async(
    items: Sequence[PollItem[A]], duration_s: float, cycles: int | None
) -> AsyncGenerator[PollResult, None]:
    bus = items[0].drive.bus
    start = bus.now()
    schedule = Schedule(items, start_s=start, cycles=cycles)
    line = _DeadLine()
    while True:
        now, due_s = bus.now(), schedule.next_due()
        if due_s == math.inf or max(now, due_s) - start >= duration_s:
            return
        item = schedule.due(now)
        if item is None:
            await bus.sleep_until(due_s)
            continue
        outcome: Reading | DriveCommError | None = line.error(now)
        if outcome is None:
            try:
                outcome = await item.drive.polled(item.parameter, **item.options)
            except DriveCommError as error:
                outcome = error
                line.note(bus.now(), error)
        yield schedule.finished(item, bus.now(), outcome, time_s=bus.wall_time())


def _poll_buses(
    lines: Sequence[Sequence[PollItem[S]]], duration_s: float, cycles: int | None
) -> Generator[PollResult, None, None]:
    # Plans on one line, the usual ones, need no threads.
    from queue import Empty, Queue  # noqa: PLC0415
    from threading import Event, Thread  # noqa: PLC0415

    results: Queue[PollResult | BaseException | None] = Queue(_WAITING_RESULTS)
    stop = Event()

    def work(items: Sequence[PollItem[S]]) -> None:
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
    lines: Sequence[Sequence[PollItem[A]]], duration_s: float, cycles: int | None
) -> AsyncGenerator[PollResult, None]:
    import asyncio  # noqa: PLC0415 - for those who have an event loop already

    results: AsyncQueue[PollResult | BaseException | None] = asyncio.Queue(_WAITING_RESULTS)

    async def work(items: Sequence[PollItem[A]]) -> None:
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
        raise UsageError(f"a duration of {shortened(duration_s)} s polls nothing; give seconds above 0")
    return duration_s
