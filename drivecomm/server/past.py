"""What was, for doors: the history is read in threads, each time with a connection of its own."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from typing import TYPE_CHECKING

from drivecomm.errors import FileFormatError
from drivecomm.server.history import History
from drivecomm.server.observations import RememberedFault

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from drivecomm.protocol import Value
    from drivecomm.server.observations import Event


_LATEST = 10_000
"""So many remembered faults are looked through."""


class Past:
    """The history of a plant, for event loops. file: what the journal writes."""

    def __init__(self, file: Path) -> None:
        self._file = file

    async def points(
        self, drive: str, name: str, from_s: float, to_s: float, points: int
    ) -> Sequence[tuple[float, Value | None, str]]:
        """Return the course of a quantity in about so many points. Raises UsageError for one that was never read."""

        def read() -> list[tuple[float, Value | None, str]]:
            with History(self._file) as history:
                found = history.points(drive, name, from_s, to_s, points)
            return [(each.time_s, each.value, each.quality) for each in found]

        return await asyncio.to_thread(read)

    async def events(self, *, drive: str, kind: str, from_s: float, to_s: float, limit: int) -> Sequence[Event]:
        """Return the latest events that fit, the oldest first; an empty drive or kind fits all."""

        def read() -> list[Event]:
            with History(self._file) as history:
                found = history.events(drive or None, kind or None, from_s, to_s, limit)
            return [each.event for each in found]

        return await asyncio.to_thread(read)


def remembered_faults(file: Path) -> dict[str, tuple[RememberedFault, ...]]:
    """Return what drives remembered of their faults when they were asked last, as a history has it; by drive."""
    found: dict[str, list[RememberedFault]] = {}
    with suppress(FileFormatError), History(file) as history:
        # Each log of a drive begins with its place 1; the last one counts.
        for each in history.fault_logs(limit=_LATEST):
            entries = [] if each.place == 1 else found.get(each.drive, [])
            remembered = RememberedFault(
                place=each.place, address=each.address, value=each.value, text=each.text, time_s=each.time_s
            )
            found[each.drive] = [*entries, remembered]
    return {drive: tuple(entries) for drive, entries in found.items()}
