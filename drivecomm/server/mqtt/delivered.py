"""What has reached the broker: which values went out when they came, and up to where nothing is missing.

Values go out live, and the history is gone through behind them: a row that went out live is passed over, any other one
is published afterwards. So nothing is missing, whatever was merged, lost on its way, or came while nobody was there.
"""

from __future__ import annotations

import json
from collections import deque
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivecomm.errors import FileFormatError
from drivecomm.tomlfile import write_whole

if TYPE_CHECKING:
    from pathlib import Path

    from drivecomm.server import Event
    from drivecomm.server.mqtt.content import Sample

MOST = 1_000_000
"""So many live values are remembered until the history is gone through to them; the oldest are published twice then."""
MOST_EVENTS = 10_000
_FORMAT = 1


class LiveValues:
    """The values and events that the broker has acknowledged, until the history has come to them."""

    def __init__(self) -> None:
        self._times: dict[tuple[str, str], deque[int]] = {}
        self._count = 0
        self._events: dict[tuple[int, int], None] = {}

    def add_event(self, event: Event) -> None:
        """Take note that the broker has an event."""
        self._events[event.number, round(event.time_s * 1000)] = None
        if len(self._events) > MOST_EVENTS:
            del self._events[next(iter(self._events))]

    def take_event(self, event: Event) -> bool:
        """Whether the broker has this event of the history, which is asked for once."""
        return self._events.pop((event.number, round(event.time_s * 1000)), self) is None

    def add(self, sample: Sample) -> None:
        """Take note that the broker has a value."""
        times = self._times.setdefault((sample.drive, sample.name), deque())
        times.append(sample.time_ms)
        self._count += 1
        if self._count > MOST:
            times.popleft()
            self._count -= 1

    def take(self, sample: Sample) -> bool:
        """Whether the broker has this row of the history, which is asked for once, in the order of rows."""
        times = self._times.get((sample.drive, sample.name))
        # Values that the history lost are before it; a clock that was set back may cost a repetition.
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
    """A row of the history up to which the broker has everything, and its time, by which it is recognised."""

    row: int
    time_ms: int


def read_position(file: Path) -> Position | None:
    """Return what was kept by the last run, None where there was none, or nothing can be made of it."""
    with suppress(OSError, ValueError, TypeError, KeyError):
        content = json.loads(file.read_bytes())
        if content["format"] == _FORMAT:
            return Position(int(content["row"]), int(content["time_ms"]))
    return None


def write_position(file: Path, position: Position) -> str:
    """Keep a position for the next run; return why that cannot be, empty where it was done."""
    content = {"format": _FORMAT, "row": position.row, "time_ms": position.time_ms}
    with suppress(OSError):
        file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    try:
        write_whole(file, json.dumps(content) + "\n")
    except FileFormatError as error:
        return str(error)
    return ""
