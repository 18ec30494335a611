"""Content of the fleet's page from a record: alarms of all plants, and the curve of a quantity as a picture."""

from __future__ import annotations

import asyncio
import time
from contextlib import closing
from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import escape

from drivecomm.server.record import RecordQueries, TimePeriod

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from drivecomm.server.record import Database

_POINTS = 500
_WIDTH, _HEIGHT = 1000, 200
_MOST_ALARMS = 200


class RecordPages:
    """The record behind the page, opened and read in a thread for each request.

    Methods raise LinkDownError, and UsageError for unknown names.
    """

    def __init__(self, open_database: Callable[[], Database]) -> None:
        self._open = open_database

    async def alarms(self) -> list[dict[str, Any]]:
        """Return the latest alarms of all plants, the latest first."""

        def read() -> list[dict[str, Any]]:
            with closing(self._open()) as database:
                return RecordQueries(database).alarms(limit=_MOST_ALARMS)[::-1]

        return await asyncio.to_thread(read)

    async def trend(self, plant: str, drive: str, quantity: str, seconds: float) -> str:
        """Return the curve of a quantity over the last `seconds`, as SVG."""

        def read() -> str:
            now = time.time()
            with closing(self._open()) as database:
                points = RecordQueries(database).points(plant, drive, quantity, TimePeriod(now - seconds, now), _POINTS)
            return _picture(f"{drive} {quantity}", points, now - seconds, seconds)

        return await asyncio.to_thread(read)


def _picture(title: str, points: Sequence[tuple[float, float]], begin_s: float, seconds: float) -> str:
    lowest = min((value for _, value in points), default=0.0)
    highest = max((value for _, value in points), default=0.0)
    extent = (highest - lowest) or 1.0
    line, last = [], None
    for time_s, value in points:
        # A pause in the record becomes a gap in the line.
        is_apart = last is None or time_s - last > 3 * seconds / _POINTS
        x, y = _WIDTH * (time_s - begin_s) / seconds, _HEIGHT * (1 - (value - lowest) / extent)
        line.append(f"{'M' if is_apart else 'L'}{x:.1f} {y:.1f}")
        last = time_s
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 -20 {_WIDTH} {_HEIGHT + 40}">'
        f"<title>{escape(title)}</title>"
        f'<path d="{" ".join(line)}" fill="none" stroke="#3878c8" stroke-width="2"/>'
        f'<text x="4" y="-6" font-size="14" fill="#808080">{escape(title)}, up to {highest:g}</text>'
        f'<text x="4" y="{_HEIGHT + 16}" font-size="14" fill="#808080">down to {lowest:g}</text></svg>'
    )
