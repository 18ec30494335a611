"""Carrying out poll plans, on as many lines as the drives are on: for callers that block, and over asyncio.

The schedule decides whose turn it is; the loops only wait, read, and hand over results.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from drivecomm.errors import DriveCommError, UsageError, in_one_line, shortened
from drivecomm.line.poll_items import PollBlock, PollItem, PollResult, checked
from drivecomm.line.polling import D, Polling, poll_bus
from drivecomm.protocol import is_duration

if TYPE_CHECKING:
    from asyncio import Queue as AsyncQueue
    from collections.abc import AsyncGenerator, Generator, Iterable, Sequence


_WAITING_RESULTS = 1000
"""So many results wait for a slow reader, then the lines wait for it."""


def poll(
    items: Iterable[PollItem[D]], *, duration_s: float | None = None, cycles: int | None = None
) -> Generator[PollResult, None, None]:
    """Yield the results of a plan in the order in which they come, from as many buses as its drives are on.

    Ends when each item has had `cycles` results, or after `duration_s` on each bus's clock; with neither it goes on
    until it is closed. Whatever fails is a result of its item and never ends the plan; a line that is down is tried
    again every half second. One thread serves the lines when there are several. Raises UsageError for a plan that
    cannot be carried out or that has what can never be read, and when a bus has been closed.
    """
    lines, end_s = _by_bus(readable(checked(items, cycles=cycles))), _seconds(duration_s)
    if len(lines) == 1:
        return poll_bus(lines[0], end_s, cycles)
    # Plans on one line, the usual ones, need no threads.
    from drivecomm.line.many_lines import poll_together

    return poll_together(lines, end_s, cycles)


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
            refused.append(f"{item.name or item.drive.name} {item.parameter} ({in_one_line(error)})")
    if refused:
        raise UsageError(f"the plan has what can never be read, take it out: {', '.join(refused)}")
    return items


async def _poll_bus_async(
    items: Sequence[PollItem[D]], duration_s: float, cycles: int | None
) -> AsyncGenerator[PollResult, None]:
    polling = Polling(items, duration_s, cycles)
    bus = polling.bus
    while (due := polling.next(bus.now())) is not None:
        if isinstance(due, PollItem | PollBlock):
            try:
                outcome = await (
                    due.drive.polled(due.parameter, **due.options)
                    if isinstance(due, PollItem)
                    else due.drive.polled_many(due.parameters)
                )
            except DriveCommError as error:
                outcome = error
            for result in polling.finished(due, outcome, bus.now()):
                yield result
        elif isinstance(due, list):
            for result in due:
                yield result
        else:
            await bus.sleep_until(due)


async def _poll_buses_async(
    lines: Sequence[Sequence[PollItem[D]]], duration_s: float, cycles: int | None
) -> AsyncGenerator[PollResult, None]:
    import asyncio

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
