"""What hosts have missed, from the history: after an outage, after this server was away, and around either.

Data goes out with QoS 0. What left in the last moments before a connection was lost may never have come to the broker,
and that it is lost is noticed one and a half keep-alives later at the worst. So everything of the last two keep-alives
is sent again, marked as historical; hosts know it by its times.

Sparkplug 4 is going to have historical values in messages of their own, and not marked one by one. They are in messages
of their own here, too: `EdgeNode.past` makes them, and nothing else would change.
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

    from drivecomm.server import History, PastValue
    from drivecomm.server.sparkplug.edge_node import EdgeNode
    from drivecomm.server.sparkplug.kept import KeptSession
    from drivecomm.server.sparkplug.outlet import Outlet

MOST_METRICS = 250
"""So many values are in one message at most; data of now goes between two of them."""
_PAUSE_S = 0.01
_AGAIN_S = 0.5
_LOOKED_AFTER_S = 3.0
_COMMITTED_S = 2.0
"""What was true before is in the history after so long."""

_log = logging.getLogger("drivecomm.server")


class Backlog:
    """Passes on what hosts have missed. keep_alive_s: of the broker's connection."""

    def __init__(self, history: History, kept: KeptSession, keep_alive_s: float) -> None:
        self._history, self._kept = history, kept
        self._unsure_s = 2 * keep_alive_s
        self._sent: deque[tuple[float, Callable[[], None]]] = deque()

    async def begin(self) -> None:
        """Take note of where the history is, the first time; what comes from now on is passed on, if only later."""
        latest = await self._history.last_row()
        if self._kept.row is None:
            self._kept.passed_on(latest)
        elif self._kept.row > latest:
            # It is another file now.
            self._kept.waiting.clear()
            self._kept.passed_on(0)
        await asyncio.to_thread(self._kept.save)

    async def serve(self, node: EdgeNode, outlet: Outlet, born_s: float) -> None:
        """Pass on what was missed until the births, and take note of what surely was passed on, until cancelled."""
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
        """Take note that the broker has everything that was sent: it has acknowledged what came after it."""
        if not self._sent:
            # Who was interrupted while catching up begins there again.
            return
        self._sent.clear()
        self._kept.passed_on(await self._history.last_row())
        await asyncio.to_thread(self._kept.save)

    async def _catch_up(self, node: EdgeNode, outlet: Outlet, row: int, born_s: float) -> int:
        """Pass on everything until the births; return the row up to which that was."""
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
        """Take note of what hosts have by now, and pass on what waits for a drive when it is there again."""
        late: set[str] = set()
        while True:
            for drive in [each for each in self._kept.waiting if each not in late and node.is_born(each)]:
                await self._send_waiting(node, outlet, drive)
                late.add(drive)
                self._will_be_sure(partial(self._kept.passed_on_later, drive))
            # What is committed now was sent when it came.
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
    """Yield the values that say something else than the ones before them, as data of now does."""
    for value in values:
        before = last.get((value.drive, value.name))
        if before is None or (before.value, before.quality, before.raw) != (value.value, value.quality, value.raw):
            last[value.drive, value.name] = value
            yield value


def _by_drive(values: Iterable[PastValue]) -> Iterator[tuple[str, Sequence[PastValue]]]:
    for drive, of_drive in groupby(sorted(values, key=lambda each: each.drive), key=lambda each: each.drive):
        yield drive, list(of_drive)
