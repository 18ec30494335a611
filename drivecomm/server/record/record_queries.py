"""Queries on a record for people: curves of values, events, commands and alarms of its plants."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

from drivecomm.errors import UsageError, suggestion
from drivecomm.server.record.database import TO_THE_END_MS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from drivecomm.server.record.database import Database


class TimePeriod(NamedTuple):
    """Period in seconds since 1970; None for an open end."""

    from_s: float | None = None
    to_s: float | None = None


class RecordedValue(NamedTuple):
    """Recorded value; `value` is None if there was none."""

    drive: str
    quantity: str
    time_s: float
    value: Any
    unit: str
    quality: str
    text: str
    note: str


class RecordQueries:
    """Reader of a record. Methods raise LinkDownError, and UsageError for an unknown plant."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def plants(self) -> list[str]:
        """Return the names of all plants."""
        return [name for (name,) in self._database.all("SELECT name FROM plant ORDER BY name")]

    def values(
        self, plant: str, drive: str, quantities: Sequence[str], stretch: TimePeriod, limit: int
    ) -> list[RecordedValue]:
        """Return the latest values of a drive, oldest first. quantities: only these; empty for all.

        Raises UsageError for an unknown drive or quantity.
        """
        known = self._quantities(plant, drive)
        numbers = [known[name] for name in known if name in quantities or not quantities]
        for name in quantities:
            if name not in known:
                raise UsageError(f"the record has no {name!r} of {drive}; {suggestion(name, list(known), 'it has')}")
        found = self._rows(
            "SELECT quantity.name, {time}, value.number, value.string, remark.unit, remark.quality, remark.text, "  # noqa: S608
            "remark.note FROM value JOIN quantity ON quantity.id = value.quantity JOIN remark ON remark.id = "
            f"value.remark WHERE value.quantity IN ({', '.join(['%s'] * len(numbers))})",
            "value.time",
            numbers,
            stretch,
            limit,
        )
        return [
            RecordedValue(drive, name, time_ms / 1000, string if number is None else number, *said)
            for name, time_ms, number, string, *said in found
        ]

    def points(
        self, plant: str, drive: str, quantity: str, stretch: TimePeriod, points: int
    ) -> list[tuple[float, Any]]:
        """Return times and means of a quantity in equal parts of a period, without empty parts.

        stretch: must have both ends. points: number of parts.
        """
        number = self._quantities(plant, drive).get(quantity)
        if number is None or stretch.from_s is None or stretch.to_s is None:
            raise UsageError(f"the record has no {quantity!r} of {drive}")
        begin, end = round(stretch.from_s * 1000), round(stretch.to_s * 1000)
        part, database = max(1, (end - begin) // points), self._database
        time, moment = database.milliseconds("time"), database.moment()
        found = database.all(
            f"SELECT ({time} - %s) / %s AS part, avg(number) FROM value WHERE quantity = %s AND number IS NOT NULL "  # noqa: S608
            f"AND time BETWEEN {moment} AND {moment} GROUP BY part ORDER BY part",
            (begin, part, number, begin, end),
        )
        return [((begin + (each + 0.5) * part) / 1000, float(mean)) for each, mean in found]

    def events(self, plant: str, drive: str, stretch: TimePeriod, limit: int) -> list[dict[str, Any]]:
        """Return the latest events of a plant, oldest first. drive: only events of this drive; "" for all."""
        names = ("kind", "text", "drive", "line", "who", "alarm")
        return self._logged("event", names, self._of(plant, drive), stretch, limit)

    def commands(self, plant: str, drive: str, stretch: TimePeriod, limit: int) -> list[dict[str, Any]]:
        """Return the latest commands of a plant, oldest first. drive: only commands to this drive; "" for all."""
        names = ("who", "door", "drive", "verb", "arguments", "outcome", "text")
        return self._logged("command", names, self._of(plant, drive), stretch, limit)

    def alarms(self, plant: str = "", stretch: TimePeriod | None = None, limit: int = 1000) -> list[dict[str, Any]]:
        """Return the latest alarms, oldest first. plant: "" for all plants. stretch: only alarms that began in it."""
        names = ("plant", "id", "rule", "drive", "text", "times", "acknowledged_by")
        times = ("since", "over", "acknowledged", "ended")
        read = ", ".join(f"{self._database.milliseconds(f'alarm.{name}')} AS {name}_ms" for name in times)
        found = self._rows(
            f"SELECT {{time}}, plant.name, alarm.id, rule, drive, text, times, acknowledged_by, {read} "  # noqa: S608
            f"FROM alarm JOIN plant ON plant.id = alarm.plant WHERE {'plant.name = %s' if plant else '1 = 1'}",
            "alarm.since",
            [plant] if plant else [],
            stretch or TimePeriod(),
            limit,
        )
        return [{**dict(zip(names, said, strict=False)), **_seconds(times, said[len(names) :])} for _, *said in found]

    def _logged(
        self, table: str, names: Sequence[str], wanted: Mapping[str, object], stretch: TimePeriod, limit: int
    ) -> list[dict[str, Any]]:
        where = " AND ".join(f"{name} = %s" for name in wanted)
        found = self._rows(
            f"SELECT {{time}}, {', '.join(names)} FROM {table} WHERE {where}",  # noqa: S608
            "time",
            list(wanted.values()),
            stretch,
            limit,
        )
        return [{"time_s": time_ms / 1000, **dict(zip(names, said, strict=True))} for time_ms, *said in found]

    def _of(self, plant: str, drive: str) -> dict[str, object]:
        return {"plant": self._plant(plant), **({"drive": drive} if drive else {})}

    def _rows(
        self, question: str, time: str, values: Sequence[object], stretch: TimePeriod, limit: int
    ) -> list[tuple[Any, ...]]:
        """Return the latest rows of a period, oldest first.

        question: SQL up to its conditions. time: column of the time.
        """
        database = self._database
        begin, end = (
            otherwise if each is None else round(each * 1000)
            for each, otherwise in zip(stretch, (0, TO_THE_END_MS), strict=True)
        )
        question = question.format(time=database.milliseconds(time))
        moment = database.moment()
        found = database.all(
            f"{question} AND {time} BETWEEN {moment} AND {moment} ORDER BY {time} DESC LIMIT %s",
            (*values, begin, end, limit),
        )
        return found[::-1]

    def _plant(self, name: str) -> int:
        found = self._database.all("SELECT id FROM plant WHERE name = %s", (name,))
        if not found:
            raise UsageError(f"the record has no plant {name!r}; {suggestion(name, self.plants(), 'it has')}")
        return int(found[0][0])

    def _quantities(self, plant: str, drive: str) -> dict[str, int]:
        rows = self._database.all("SELECT drive, name, id FROM quantity WHERE plant = %s", (self._plant(plant),))
        drives = sorted({row[0] for row in rows})
        if drive not in drives:
            raise UsageError(f"the record has no drive {drive!r} of {plant}; {suggestion(drive, drives, 'it has')}")
        return {name: number for its, name, number in sorted(rows) if its == drive}


def _seconds(names: Sequence[str], times_ms: Sequence[int | None]) -> dict[str, float | None]:
    return {f"{name}_s": None if each is None else each / 1000 for name, each in zip(names, times_ms, strict=True)}
