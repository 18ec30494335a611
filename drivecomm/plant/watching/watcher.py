"""Watcher of the drives on several lines: polls them, stores the latest results, and reports each result.

async with Watcher(lines_of(plant)) as watcher:
    await watcher.run(duration_s=60)
    print(watcher.board())
"""

from __future__ import annotations

import asyncio
from collections import Counter, deque
from contextlib import ExitStack
from dataclasses import replace
from decimal import Decimal
from functools import partial
from typing import TYPE_CHECKING, Self

from drivecomm.bus import AsyncBus, open_bus_async
from drivecomm.errors import LinkError, UsageError, in_one_line
from drivecomm.line import STATUS, PollItem, poll_async
from drivecomm.link import REOPEN_LONGEST_S, Statistics
from drivecomm.models import quantities
from drivecomm.plant import async_bus_of_server
from drivecomm.plant.watching.board import Board, DriveEvent, DriveView, Trend, WatchedValue, changes
from drivecomm.plant.watching.watched_drive import OpenLine, TrackedDrive, has_answered

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence
    from contextlib import AbstractContextManager

    from drivecomm.bus import AsyncDrive
    from drivecomm.line import PollResult
    from drivecomm.link import TraceEvent
    from drivecomm.plant.watching.watched_drive import WatchedLine

USUAL_NAMES = (
    "output_frequency",
    "output_current",
    "output_power",
    "dc_link_voltage",
    "motor_speed",
    "torque",
    "torque_percent",
    "heat_sink_temperature",
)
"""Common names that are watched by default, as far as the model of a drive maps them."""

_KEPT_EVENTS = 200
_KEPT_PERIODS = 3
_TREND_PERIODS = 60


class Watcher:
    """Watcher of drives: an asynchronous context manager that holds their lines open; sends no commands by itself.

    names: common names to read from each drive whose model maps them. period_s: seconds between reads. told: called
    with every result, the status as a result with the name "status". A drive or a line that fails is shown as silent,
    and delays no other. Entering raises the first LinkError if none of the lines can be opened; otherwise lines that
    failed are retried. holding: context manager that is entered with each port opened here and its bus, and left when
    the port closes.
    """

    def __init__(
        self,
        lines: Iterable[WatchedLine],
        *,
        names: Sequence[str] = USUAL_NAMES,
        period_s: float = 1.0,
        told: Callable[[PollResult], None] | None = None,
        holding: Callable[[str, AsyncBus], AbstractContextManager[object]] | None = None,
    ) -> None:
        for name in names:
            if name not in quantities():
                raise UsageError(f"unknown common name {name!r}; drivecomm models names lists them")
        if not 0 < period_s < float("inf"):
            raise UsageError(f"invalid period of {period_s:g} s; write seconds above 0")
        self.names = tuple(names)
        self.period_s = period_s
        self.told = told
        """Called with every result; may be changed while watching."""
        self._holding = holding
        self._held = ExitStack()
        self._began_s: float | None = None
        self._events: deque[DriveEvent] = deque(maxlen=_KEPT_EVENTS)
        self._seen: dict[str, TrackedDrive] = {}
        self._lines = [self._made(line) for line in lines]
        if not self._lines:
            raise UsageError("there is nothing to watch; name drives, or a plant with some")

    @property
    def unmapped_names(self) -> list[str]:
        """Names that are read from no drive, because no model of these drives maps them."""
        known = {name for seen in self._seen.values() if seen.drive.model for name in seen.drive.model.quantities}
        return [name for name in self.names if name not in known]

    def _made(self, watched: WatchedLine) -> OpenLine:
        opening = {**watched.options, "trace": partial(self._traced, watched)}
        served = async_bus_of_server(watched.port, **opening) if isinstance(watched.port, str) else None
        line = OpenLine(watched, served or open_bus_async(watched.port, **opening))
        for one in watched.drives:
            if one.name in self._seen:
                raise UsageError(f"two drives are named {one.name!r}; give each a name of its own")
            self._seen[one.name] = TrackedDrive(
                line, one.build(line.bus.drive), DriveView(drive=one, line=watched.name)
            )
        return line

    async def __aenter__(self) -> Self:
        try:
            await self._open()
        except BaseException:
            await self._close()
            raise
        return self

    async def __aexit__(self, *_: object) -> None:
        await self._close()

    async def run(self, *, duration_s: float | None = None) -> None:
        """Watch until cancelled, or for duration_s seconds on each line's clock."""
        tasks = [asyncio.create_task(self._watch(line, duration_s)) for line in self._lines]
        try:
            await asyncio.gather(*tasks)
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    def board(self) -> Board:
        """Return a snapshot of all drives and events."""
        return Board(
            drives=tuple(self._view(seen) for seen in self._seen.values()),
            events=tuple(sorted(self._events, key=lambda one: one.time_s, reverse=True)),
            elapsed_s=max(line.elapsed_s for line in self._lines),
            began_s=self._began_s,
        )

    @property
    def trend_s(self) -> float:
        """Seconds that `cells` covers: sixty periods, a minute at least."""
        return _TREND_PERIODS * max(1.0, self.period_s)

    def cells(self, drive: str, name: str, number: int) -> list[float | None]:
        """Return the curve of a quantity up to now in N cells; None in a cell without a value."""
        seen = self._seen[drive]
        trend = seen.trends.get(name)
        if trend is None:
            return [None] * number
        return trend.cells(number, until_s=seen.line.elapsed_s, each_s=self.trend_s / number)

    def telegrams(self, drive: str) -> Sequence[TraceEvent]:
        """Return the latest telegrams of a drive, the oldest first."""
        return tuple(self._seen[drive].telegrams)

    def drive(self, name: str) -> AsyncDrive:
        """Return a drive, to read or command it between the watcher's requests."""
        return self._seen[name].drive

    def note(self, drive: str, text: str) -> None:
        """Add a user's command to the events."""
        time_s = self._seen[drive].line.elapsed_s
        self._events.append(DriveEvent(time_s=time_s, drive=drive, kind="command", text=text))

    def _traced(self, line: WatchedLine, event: TraceEvent) -> None:
        for one in line.drives:
            if str(one) == event.drive:
                self._seen[one.name].telegrams.append(event)

    async def _open(self) -> None:
        errors = await asyncio.gather(*(self._opened(line) for line in self._lines))
        if (first := errors[0]) is not None and all(errors):
            raise first

    async def _opened(self, line: OpenLine, late_s: float = 0.0) -> LinkError | None:
        """Open a line and show a failure with its drives. late_s: seconds since watching began."""
        try:
            await line.bus.__aenter__()
        except LinkError as error:
            for seen in self._on(line):
                self._update(seen, seen.view.silent(in_one_line(error)))
            return error
        if self._holding is not None and isinstance(line.watched.port, str) and isinstance(line.bus, AsyncBus):
            self._held.enter_context(self._holding(line.watched.port, line.bus))
        line.is_open = True
        line.now_s = line.bus.now()
        line.began_s = line.now_s - late_s
        if line.bus.real_time and self._began_s is None:
            self._began_s = line.bus.wall_time() - late_s
        return None

    async def _close(self) -> None:
        # Closing may wait for work of the event loop, so it must not block it.
        await asyncio.to_thread(self._held.close)
        for line in self._lines:
            if line.is_open:
                line.now_s = line.bus.now()
            line.is_open = False
            await line.bus.close()

    async def _watch(self, line: OpenLine, duration_s: float | None) -> None:
        # A line that is not open has no clock, so its times are those of the event loop.
        loop = asyncio.get_running_loop()
        began_s, left_s = loop.time(), duration_s
        while not line.is_open:
            late_s = loop.time() - began_s
            left_s = None if duration_s is None else duration_s - late_s
            if left_s is not None and left_s <= 0:
                return
            await asyncio.sleep(REOPEN_LONGEST_S if left_s is None else min(REOPEN_LONGEST_S, left_s))
            await self._opened(line, loop.time() - began_s)
        async for result in poll_async(self._plan(line), duration_s=left_s):
            self._take(self._seen[result.drive], result)
            if self.told is not None:
                self.told(result)

    def _plan(self, line: OpenLine) -> list[PollItem[TrackedDrive]]:
        items = []
        for seen in self._on(line):
            known = seen.drive.model.quantities if seen.drive.model else {}
            asked = [STATUS, *(name for name in self.names if name in known)]
            items += [
                PollItem(drive=seen, parameter=name, period_s=self.period_s, name=seen.view.name) for name in asked
            ]
            for name in asked[1:]:
                seen.trends.setdefault(name, Trend(keeps_s=_KEPT_PERIODS * self.period_s))
        return items

    def _on(self, line: OpenLine) -> list[TrackedDrive]:
        return [seen for seen in self._seen.values() if seen.line is line]

    def _take(self, seen: TrackedDrive, result: PollResult) -> None:
        cause = result.cause.removeprefix(f"{seen.drive.name}: ").removeprefix(f"{seen.drive.name} ")
        view = seen.view_after(result, cause)
        if has_answered(result.error):
            seen.answered_s = seen.line.elapsed_s
        if result.parameter != STATUS:
            value = WatchedValue(
                name=result.parameter, reading=result.reading, quality=result.quality, cause=result.cause
            )
            view = replace(view, values={**view.values, result.parameter: value})
            seen.trends[result.parameter].add(seen.line.elapsed_s, _number(result))
        self._update(seen, view)

    def _update(self, seen: TrackedDrive, view: DriveView) -> None:
        self._events.extend(changes(seen.view, view, seen.line.elapsed_s))
        seen.view = view

    def _view(self, seen: TrackedDrive) -> DriveView:
        counted = seen.line.bus.statistics.get(seen.drive.name, Statistics())
        return replace(
            seen.view,
            age_s=None if seen.answered_s is None else seen.line.elapsed_s - seen.answered_s,
            counters=Counter(counted.counters),
            reply_s=counted.reply_times.mean_s,
        )


def _number(result: PollResult) -> float | None:
    if result.error is not None or result.reading is None:
        return None
    value = result.reading.value
    return float(value) if isinstance(value, int | Decimal) else None
