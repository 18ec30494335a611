"""One row of a value log. No I/O, no clock."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from decimal import Decimal, InvalidOperation
from typing import TYPE_CHECKING, get_args

from drivecomm.line import FRESH, ResultQuality

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.line import PollResult

QUALITIES: tuple[ResultQuality, ...] = get_args(ResultQuality)

COLUMNS = ("time", "drive", "name", "address", "value", "unit", "text", "raw", "quality", "note")
"""Columns of a log.

time: when the value was read, or when the read failed, UTC. drive: name in the plant. name: the requested name, a
common name or an address. address: address of the parameter. value: exact, as text. text: meaning of the value, such as
a fault. raw: the raw value. note: doubts about the value, or why there is no value.
"""

BEGINNING = datetime(1970, 1, 1, tzinfo=UTC)
"""Origin of times in seconds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LogRow:
    """Value of a drive at a time; the fields are COLUMNS."""

    time: datetime
    drive: str
    name: str
    address: str = ""
    value: str = ""
    unit: str = ""
    text: str = ""
    raw: str = ""
    quality: ResultQuality = "good"
    note: str = ""

    @property
    def number(self) -> float | None:
        """Value as a number; None if it is a text, or if there is no value."""
        try:
            number = Decimal(self.value)
        except InvalidOperation:
            return None
        return float(number) if number.is_finite() else None

    @property
    def is_fresh(self) -> bool:
        """Whether the drive gave this value in reply to this request."""
        return self.quality in FRESH

    def texts(self) -> dict[str, str]:
        """Return the row as texts by column, each on one line, the time in ISO 8601."""
        # A line break within a text would make a row that is cut off look complete.
        content = {name: " ".join(str(getattr(self, name)).splitlines()) for name in COLUMNS}
        content["time"] = self.time.isoformat(timespec="milliseconds").replace("+00:00", "Z")
        return content


def row_of(result: PollResult) -> LogRow:
    """Return the row of a poll result."""
    reading = result.reading
    # Times of a virtual line begin at 0, and datetime.fromtimestamp rejects small negative times on some systems.
    time = BEGINNING + timedelta(seconds=result.time_s)
    if reading is None:
        return LogRow(time=time, drive=result.drive, name=result.parameter, quality=result.quality, note=result.cause)
    return LogRow(
        time=time,
        drive=result.drive,
        name=result.parameter,
        address=reading.parameter,
        value=str(reading.value),
        unit=reading.unit,
        text=reading.text,
        raw=str(reading.raw),
        quality=result.quality,
        note=result.remark,
    )


def row_from(content: Mapping[str, str]) -> LogRow:
    """Return the row made of these texts. Raises ValueError for an invalid time or quality."""
    time = datetime.fromisoformat(content["time"])
    quality = next((each for each in QUALITIES if each == content["quality"]), None)
    if quality is None or time.tzinfo is None:
        raise ValueError("no time with its zone, or no quality")
    others = {name: content[name] for name in COLUMNS if name not in ("time", "quality")}
    return LogRow(time=time.astimezone(UTC), quality=quality, **others)
