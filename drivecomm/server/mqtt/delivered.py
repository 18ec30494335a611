"""Deliveries to the broker: live values, and the position in the history up to which it has everything.

Values are published live, and the history is read behind them. A row that was published live is skipped; any other row
is published late. So nothing is missing, even if values were merged, lost in transit or read while disconnected.
"""

from __future__ import annotations

import json
from collections import deque
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivecomm.errors import FileFormatError
from drivecomm.tomlfile import write_atomically

if TYPE_CHECKING:
    from pathlib import Path

    from drivecomm.server import Event
    from drivecomm.server.mqtt.content import PublishedValue

MOST = 1_000_000
"""Maximum number of remembered live values; beyond that, the oldest are published twice."""
MOST_EVENTS = 10_000
_FORMAT = 1


class LiveValues:
    """Values and events that the broker has acknowledged and the history has not reached yet."""

    def __init__(self) -> None:
        self._times: dict[tuple[str, str], deque[int]] = {}
        self._count = 0
        self._events: dict[tuple[int, int], None] = {}

    def add_event(self, event: Event) -> None:
        """Record that the broker has an event."""
        self._events[event.number, round(event.time_s * 1000)] = None
        if len(self._events) > MOST_EVENTS:
            del self._events[next(iter(self._events))]

    def take_event(self, event: Event) -> bool:
        """Whether the broker has this event of the history. Call once per event."""
        return self._events.pop((event.number, round(event.time_s * 1000)), self) is None

    def add(self, sample: PublishedValue) -> None:
        """Record that the broker has a value."""
        times = self._times.setdefault((sample.drive, sample.name), deque())
        times.append(sample.time_ms)
        self._count += 1
        if self._count > MOST:
            times.popleft()
            self._count -= 1

    def take(self, sample: PublishedValue) -> bool:
        """Whether the broker has this row of the history. Call once per row, in the order of rows."""
        times = self._times.get((sample.drive, sample.name))
        # Earlier values are missing from the history. A clock that was set back may cause a repetition.
        while times and times[0] < sample.time_ms:
            times.popleft()
            self._count -= 1
        if not times or times[0] != sample.time_ms:
            return False
        times.popleft()
        self._count -= 1
        return True


@dataclass(frozen=True, slots=True)
class Position:
    """Row of the history up to which the broker has everything. time_ms: its time, which identifies the row."""

    row: int
    time_ms: int


def read_position(file: Path) -> Position | None:
    """Return the position saved by the last run, None if there is none or it is unreadable."""
    with suppress(OSError, ValueError, TypeError, KeyError):
        content = json.loads(file.read_bytes())
        if content["format"] == _FORMAT:
            return Position(int(content["row"]), int(content["time_ms"]))
    return None


def write_position(file: Path, position: Position) -> str:
    """Save a position for the next run; return the reason for failure, "" on success."""
    content = {"format": _FORMAT, "row": position.row, "time_ms": position.time_ms}
    with suppress(OSError):
        file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    try:
        write_atomically(file, json.dumps(content) + "\n")
    except FileFormatError as error:
        return str(error)
    return ""
