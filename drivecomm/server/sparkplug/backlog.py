"""Late delivery of values that hosts have missed, from the history, after an outage or a restart.

Data is sent with QoS 0. Messages from the last moments of a lost connection may not have reached the broker, and the
loss is noticed at most one and a half keep-alives later. So everything of the last two keep-alives is sent again,
marked as historical; hosts recognise repetitions by their times.

Sparkplug 4 is going to have separate messages for historical values instead of a mark on each one. They are in separate
messages here as well: `EdgeNode.past` makes them, and nothing else would change.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections import deque
from functools import partial
from itertools import groupby
from typing import TYPE_CHECKING

from drivecomm.errors import FileFormatError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from drivecomm.server import PastValue, PlantHistory
    from drivecomm.server.sparkplug.edge_node import EdgeNode
    from drivecomm.server.sparkplug.edge_node_state import EdgeNodeState
    from drivecomm.server.sparkplug.outlet import Outlet

MOST_METRICS = 250
"""Maximum values in one message; current data is sent between two messages."""
_PAUSE_S = 0.01
_AGAIN_S = 0.5
_LOOKED_AFTER_S = 3.0
_COMMITTED_S = 2.0
"""Seconds after which a value is certainly in the history."""

_log = logging.getLogger("drivecomm.server")


class Backlog:
    """Delivery of missed values. keep_alive_s: keep-alive time in seconds of the broker connection."""

    def __init__(self, history: PlantHistory, kept: EdgeNodeState, keep_alive_s: float) -> None:
        self._history, self._kept = history, kept
        self._unsure_s = 2 * keep_alive_s
        self._sent: deque[tuple[float, Callable[[], None]]] = deque()

    async def begin(self) -> None:
        """Start at the present end of the history if there is no saved position, or at 0 in a restarted history."""
        latest = await self._history.last_row()
        if self._kept.row is None:
            self._kept.passed_on(latest)
        elif self._kept.row > latest:
            # The history file has been replaced.
            self._kept.waiting.clear()
            self._kept.passed_on(0)
        await asyncio.to_thread(self._kept.save)

    async def serve(self, node: EdgeNode, outlet: Outlet, born_s: float) -> None:
        """Deliver values from before the births, and save the position of certain deliveries, until cancelled."""
        self._sent.clear()
        row = self._kept.row or 0
        while True:
            try:
                row = await self._catch_up(node, outlet, row, born_s)
                await self._go_on(node, outlet, row)
            except FileFormatError as error:
                _log.warning("sparkplug cannot read what hosts have missed: %s", error)
                await asyncio.sleep(30.0)

    async def all_passed_on(self) -> None:
        """Record that the broker has everything: it has acknowledged a later message."""
        if not self._sent:
            # A catch-up that was interrupted starts again from the saved position.
            return
        self._sent.clear()
        self._kept.passed_on(await self._history.last_row())
        await asyncio.to_thread(self._kept.save)

    async def _catch_up(self, node: EdgeNode, outlet: Outlet, row: int, born_s: float) -> int:
        """Deliver everything from before the births; return the last row of that."""
        last: dict[tuple[str, str], PastValue] = {}
        while True:
            done = time.time() > born_s + _COMMITTED_S
            async for values in self._history.since(row):
                missed = [each for each in values if each.time_s <= born_s]
                for drive, of_drive in _by_drive(_new(missed, last)):
                    if node.is_born(drive):
                        await self._send(node, outlet, drive, of_drive)
                    else:
                        self._kept.waits(drive, row, of_drive[-1].row)
                if missed:
                    row = missed[-1].row
                    self._will_be_sure(partial(self._kept.passed_on, row))
                await self._be_sure()
                if len(missed) < len(values):
                    return row
            if done:
                return row
            await asyncio.sleep(_AGAIN_S)

    async def _go_on(self, node: EdgeNode, outlet: Outlet, row: int) -> None:
        """Record live deliveries, and deliver the waiting values of a drive once it is born again."""
        late: set[str] = set()
        while True:
            for drive in [each for each in self._kept.waiting if each not in late and node.is_born(each)]:
                await self._send_waiting(node, outlet, drive)
                late.add(drive)
                self._will_be_sure(partial(self._kept.passed_on_later, drive))
            # Committed rows were sent live.
            row = max(row, await self._history.last_row())
            self._will_be_sure(partial(self._kept.passed_on, row))
            await self._be_sure()
            await asyncio.sleep(min(self._unsure_s / 4, _LOOKED_AFTER_S))

    async def _send_waiting(self, node: EdgeNode, outlet: Outlet, drive: str) -> None:
        row, until = self._kept.waiting[drive]
        last: dict[tuple[str, str], PastValue] = {}
        async for values in self._history.since(row):
            missed = [each for each in values if each.drive == drive and each.row <= until]
            await self._send(node, outlet, drive, list(_new(missed, last)))
            if values[-1].row >= until:
                return

    async def _send(self, node: EdgeNode, outlet: Outlet, drive: str, values: Sequence[PastValue]) -> None:
        for first in range(0, len(values), MOST_METRICS):
            await outlet.send(partial(node.past, drive, values[first : first + MOST_METRICS]))
            await asyncio.sleep(_PAUSE_S)

    def _will_be_sure(self, note: Callable[[], None]) -> None:
        self._sent.append((asyncio.get_running_loop().time(), note))

    async def _be_sure(self) -> None:
        before = asyncio.get_running_loop().time() - self._unsure_s
        while self._sent and self._sent[0][0] <= before:
            self._sent.popleft()[1]()
        await asyncio.to_thread(self._kept.save)


def _new(values: Iterable[PastValue], last: dict[tuple[str, str], PastValue]) -> Iterator[PastValue]:
    """Yield the values that differ from their predecessors; live data is thinned in the same way."""
    for value in values:
        before = last.get((value.drive, value.name))
        if before is None or (before.value, before.quality, before.raw) != (value.value, value.quality, value.raw):
            last[value.drive, value.name] = value
            yield value


def _by_drive(values: Iterable[PastValue]) -> Iterator[tuple[str, Sequence[PastValue]]]:
    for drive, of_drive in groupby(sorted(values, key=lambda each: each.drive), key=lambda each: each.drive):
        yield drive, list(of_drive)
