"""Execution of poll plans on all lines of their drives: for blocking callers, and for asyncio.

`Polling` decides which item comes next; the loops only wait, read, and hand over results.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from drivecomm.errors import DriveCommError, UsageError, in_one_line, shortened
from drivecomm.line.delivery import NAP_S, ResultDelivery
from drivecomm.line.poll_items import PollItem, PollResult, checked
from drivecomm.line.polling import D, Polling
from drivecomm.protocol import is_duration

if TYPE_CHECKING:
    from collections.abc import AsyncGenerator, Callable, Generator, Iterable, Sequence


def poll(
    items: Iterable[PollItem[D]], *, duration_s: float | None = None, cycles: int | None = None
) -> Generator[PollResult, None, None]:
    """Yield the results of a plan in the order in which they come, from all buses of its drives.

    Ends when each item has had `cycles` results, or after `duration_s` on each bus's clock; with neither it continues
    until it is closed. A failure is a result of its item and never ends the plan; a line that is down is tried again
    every half second. If there are several lines, one thread serves them. Raises UsageError for a plan that cannot be
    carried out or that has an item which can never be read, and when a bus has been closed.
    """
    lines, end_s = _by_bus(readable(checked(items, cycles=cycles))), _seconds(duration_s)
    if len(lines) == 1:
        return poll_bus(lines[0], end_s, cycles)
    # Imported here, because plans on a single line, the usual ones, need no threads.
    from drivecomm.line.many_lines import poll_together

    return poll_together(lines, end_s, cycles)


def poll_async(
    items: Iterable[PollItem[D]], *, duration_s: float | None = None, cycles: int | None = None
) -> AsyncGenerator[PollResult, None]:
    """Yield the results of a plan for asynchronous drives on one event loop, as `poll` does."""
    lines, end_s = _by_bus(readable(checked(items, cycles=cycles))), _seconds(duration_s)
    return _poll_bus_async(lines[0], end_s, cycles) if len(lines) == 1 else _poll_buses_async(lines, end_s, cycles)


def readable(items: Sequence[PollItem[D]]) -> Sequence[PollItem[D]]:
    """Return these items. Raises UsageError if some can never be read; the error lists them with the reasons."""
    refused = []
    for item in items:
        try:
            item.drive.check_read(item.parameter, **item.options)
        except UsageError as error:
            refused.append(f"{item.name or item.drive.name} {item.parameter} ({in_one_line(error)})")
    if refused:
        raise UsageError(f"the plan has what can never be read, take it out: {', '.join(refused)}")
    return items


def _never() -> bool:
    return False


def poll_bus(
    items: Sequence[PollItem[D]], duration_s: float, cycles: int | None = None, stopped: Callable[[], bool] = _never
) -> Generator[PollResult, None, None]:
    """Yield the results of items that are all on one bus; an item that can never be read fails each time."""
    polling = Polling(items, duration_s, cycles)
    bus = polling.bus
    while not stopped() and (due := polling.next(bus.now())) is not None:
        if isinstance(due, float):
            bus.sleep_until(min(due, bus.now() + NAP_S))
            continue
        if not isinstance(due, list):
            try:
                outcome = polling.ask(due)
            except DriveCommError as error:
                outcome = error
            due = polling.finished(due, outcome, bus.now())
        yield from due


async def _poll_bus_async(
    items: Sequence[PollItem[D]], duration_s: float, cycles: int | None
) -> AsyncGenerator[PollResult, None]:
    polling = Polling(items, duration_s, cycles)
    bus = polling.bus
    while (due := polling.next(bus.now())) is not None:
        if isinstance(due, float):
            await bus.sleep_until(due)
            continue
        if not isinstance(due, list):
            try:
                outcome = await polling.ask(due)
            except DriveCommError as error:
                outcome = error
            due = polling.finished(due, outcome, bus.now())
        for result in due:
            yield result


async def _poll_buses_async(
    lines: Sequence[Sequence[PollItem[D]]], duration_s: float, cycles: int | None
) -> AsyncGenerator[PollResult, None]:
    import asyncio

    came = asyncio.Event()
    delivery = ResultDelivery(came.set)
    delivery.left = len(lines)

    async def work(items: Sequence[PollItem[D]]) -> None:
        try:
            async for result in _poll_bus_async(items, duration_s, cycles):
                delivery.give(result)
                while nap_s := delivery.nap_s():  # noqa: ASYNC110 - same rule as for threads, and readers are seldom slow
                    await asyncio.sleep(nap_s)
            delivery.end()
        except Exception as error:  # noqa: BLE001 - raised again where the results are read
            delivery.end(error)

    tasks = [asyncio.create_task(work(items)) for items in lines]
    try:
        while delivery.left:
            await came.wait()
            came.clear()
            for result in delivery.read():
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
        raise UsageError(f"invalid poll duration of {shortened(duration_s)} s; give seconds above 0")
    return duration_s
