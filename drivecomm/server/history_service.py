"""The history for doors, read in threads, with a new connection for each read."""

from __future__ import annotations

import asyncio
import time
from collections import deque
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from itertools import chain, islice
from typing import TYPE_CHECKING, TypeVar

from drivecomm.errors import FileFormatError
from drivecomm.server.history import CoursePoint, History, PeriodSummary, summarized
from drivecomm.server.observations import RememberedFault

if TYPE_CHECKING:
    from collections.abc import AsyncGenerator, Callable, Iterable, Iterator, Sequence
    from pathlib import Path

    from drivecomm.protocol import Value
    from drivecomm.server.history import PastCommand, PastEvent, PastValue
    from drivecomm.server.observations import Event


T = TypeVar("T")

_READERS = 4
"""Reads of the history that run in parallel, for all doors together; further reads wait."""
_LATEST = 10_000
"""Number of fault log entries that are read from the history."""
_PIECE = 1000
"""Values read in one batch for a reader that forwards them: some milliseconds' work."""

_FIRST_LOOK_BACK_S = 3600.0
_LONGEST_LOOK_BACK_S = 10 * 366 * 86400.0


class HistoryService:
    """The history of a plant, for event loops. file: the journal's file."""

    def __init__(self, file: Path) -> None:
        self._file = file
        # Separate from the threads of the doors' loops: long reads would delay logins, and open files without limit.
        self._readers = ThreadPoolExecutor(_READERS, thread_name_prefix="history for doors")

    async def _read(self, read: Callable[[], T]) -> T:
        return await asyncio.get_running_loop().run_in_executor(self._readers, read)

    async def points(
        self, drive: str, name: str, from_s: float, to_s: float, points: int
    ) -> Sequence[tuple[float, Value | None, str]]:
        """Return the curve of a quantity in about `points` points.

        Raises UsageError for a quantity that was never read.
        """

        def read() -> list[tuple[float, Value | None, str]]:
            with History(self._file) as history:
                found = history.points(drive, name, from_s, to_s, points)
            return [(each.time_s, each.value, each.quality) for each in found]

        return await self._read(read)

    async def values(self, drive: str, name: str, from_s: float, to_s: float, limit: int) -> Sequence[PastValue]:
        """Return the first values of a quantity between two times; backwards if to_s is before from_s."""

        def read() -> list[PastValue]:
            with History(self._file) as history:
                if from_s <= to_s:
                    return list(islice(history.values(drive, name, from_s, to_s), limit))
                return _backwards(partial(history.values, drive, name), from_s, to_s, limit)

        return await self._read(read)

    async def summaries(
        self, drive: str, name: str, stretches: Sequence[tuple[float, float]]
    ) -> Sequence[PeriodSummary]:
        """Return summaries of a numeric quantity for periods. Raises UsageError for a quantity that was never read."""

        def read() -> list[PeriodSummary]:
            begin_s, end_s = stretches[0][0], stretches[-1][1]
            with History(self._file) as history:
                between = partial(history.values, drive, name)
                before = _backwards(between, begin_s, 0.0, 1)
                course = chain(before, between(begin_s, end_s), islice(between(end_s, None), 1))
                return summarized((CoursePoint(each.time_s, each.value, each.quality) for each in course), stretches)

        return await self._read(read)

    async def events(self, *, drive: str, kind: str, from_s: float, to_s: float, limit: int) -> Sequence[Event]:
        """Return the latest matching events, the oldest first; an empty drive or kind matches all."""

        def read() -> list[Event]:
            with History(self._file) as history:
                found = history.events(drive or None, kind or None, from_s, to_s, limit)
            return [each.event for each in found]

        return await self._read(read)

    async def events_and_commands_since(
        self, event_row: int, command_row: int, limit: int
    ) -> tuple[Sequence[PastEvent], Sequence[PastCommand]]:
        """Return up to `limit` events and up to `limit` commands after these rows, the oldest first."""

        def read() -> tuple[Sequence[PastEvent], Sequence[PastCommand]]:
            with History(self._file) as history:
                return history.events_since(event_row, limit), history.commands_since(command_row, limit)

        return await self._read(read)

    async def last_rows(self) -> tuple[int, int]:
        """Return the rows of the latest event and of the latest command, 0 if there is none yet."""

        def read() -> tuple[int, int]:
            with History(self._file) as history:
                return history.last_rows()

        return await self._read(read)

    async def last_row(self) -> int:
        """Return the row of the latest value, 0 if there is none yet."""

        def read() -> int:
            with History(self._file) as history:
                return history.last_row()

        return await self._read(read)

    def since(self, row: int) -> AsyncGenerator[Sequence[PastValue], None]:
        """Yield the values of all drives after this row, in batches; ends with the latest value at the time."""
        return self._pieces(lambda history: history.since(row))

    def pieces(self, drive: str, name: str, from_s: float, to_s: float) -> AsyncGenerator[Sequence[PastValue], None]:
        """Yield the values of a quantity between two times, in batches. Raises UsageError for a quantity never read."""
        return self._pieces(lambda history: history.values(drive, name, from_s, to_s))

    async def _pieces(
        self, read: Callable[[History], Iterator[PastValue]]
    ) -> AsyncGenerator[Sequence[PastValue], None]:
        loop = asyncio.get_running_loop()
        # A connection of SQLite belongs to the thread that opened it.
        thread = ThreadPoolExecutor(1, thread_name_prefix="history for a door")
        history = await loop.run_in_executor(thread, History, self._file)
        try:
            values = read(history)
            while piece := await loop.run_in_executor(thread, lambda: list(islice(values, _PIECE))):
                yield piece
        finally:
            thread.submit(history.close)
            thread.shutdown(wait=False)


def _backwards(
    between: Callable[[float, float], Iterable[PastValue]], from_s: float, to_s: float, limit: int
) -> list[PastValue]:
    """Return the latest values before a time, the latest first.

    Searches a short time before it at first, then longer and longer times.
    """
    from_s = min(from_s, time.time() + _LONGEST_LOOK_BACK_S)
    look_back_s = _FIRST_LOOK_BACK_S
    while True:
        begin = max(to_s, from_s - look_back_s)
        found = list(deque(between(begin, from_s), maxlen=limit))
        if len(found) >= limit or begin <= to_s or look_back_s >= _LONGEST_LOOK_BACK_S:
            return found[::-1]
        look_back_s *= 16


def remembered_faults(file: Path) -> dict[str, tuple[RememberedFault, ...]]:
    """Return the fault logs of drives as last read, by drive, from the history."""
    found: dict[str, list[RememberedFault]] = {}
    with suppress(FileFormatError), History(file) as history:
        # Each reading of a fault log begins with place 1; the latest reading counts.
        for each in history.fault_logs(limit=_LATEST):
            entries = [] if each.place == 1 else found.get(each.drive, [])
            remembered = RememberedFault(
                place=each.place, address=each.address, value=each.value, text=each.text, time_s=each.time_s
            )
            found[each.drive] = [*entries, remembered]
    return {drive: tuple(entries) for drive, entries in found.items()}
