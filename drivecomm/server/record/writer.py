"""Storage of received messages: each batch as a whole, and nothing twice."""

from __future__ import annotations

import time
from operator import itemgetter
from typing import TYPE_CHECKING

from drivecomm.server.record.messages import PlantState, RecordedCommand, RecordedEvent, RecordedSample, StandingAlarms

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from drivecomm.server.record.database import Database
    from drivecomm.server.record.messages import Recorded

_MOST_REMARKS = 100_000
"""Maximum number of cached remark ids; others are looked up again."""


class Writer:
    """Writer to an open database. After an error, it must be replaced together with the database."""

    def __init__(self, database: Database) -> None:
        self._database = database
        self._plants: dict[str, int] = {}
        self._quantities: dict[tuple[str, str, str], int] = {}
        self._remarks: dict[tuple[str, str, str, str], int] = {}
        # A message with all values of a drive repeats values that were stored before.
        self._latest: dict[int, int] = {}

    def write(self, batch: Sequence[Recorded]) -> int:
        """Store a batch as a whole, and return the number of new values.

        Raises LinkDownError, or ValueError for content that the database cannot store.
        """
        database = self._database
        try:
            # In a transaction of its own, so that other recorders wait for new ids only briefly.
            with database.transaction():
                samples = self._rows_of(
                    sorted((each for each in batch if isinstance(each, RecordedSample)), key=itemgetter(0, 1, 2, 3))
                )
                events = [(self._plant(each.plant), *each[1:]) for each in batch if isinstance(each, RecordedEvent)]
                commands = [(self._plant(each.plant), *each[1:]) for each in batch if isinstance(each, RecordedCommand)]
        except BaseException:
            # Drop the cached ids, because the rollback has removed the new ones from the database.
            for known in (self._plants, self._quantities, self._remarks):
                known.clear()
            raise
        with database.transaction():
            # Sorted by key, so that recorders that store the same rows cannot deadlock.
            new = database.add("value", sorted(samples, key=itemgetter(0, 1))) if samples else 0
            if events:
                database.add("event", sorted(events))
            if commands:
                database.add("command", sorted(commands))
            for each in batch:
                if isinstance(each, StandingAlarms):
                    self._write_alarms(each)
                elif isinstance(each, PlantState):
                    self._write_plant(each)
        self._latest.update({quantity: time_ms for quantity, time_ms, *_ in samples})
        return new

    def _rows_of(
        self, samples: Iterable[RecordedSample]
    ) -> list[tuple[int, int, str | None, str | None, int, int | None]]:
        rows = []
        for each in samples:
            quantity = self._quantity(each.plant, each.drive, each.name)
            if self._latest.get(quantity) != each.time_ms:
                remark = self._remark(each.unit, each.quality, each.text, each.note)
                rows.append((quantity, each.time_ms, each.number, each.string, remark, each.source_ms))
        return rows

    def _plant(self, name: str) -> int:
        known = self._plants.get(name)
        if known is None:
            known = self._plants[name] = self._number("plant", ("name",), (name,))
        return known

    def _quantity(self, plant: str, drive: str, name: str) -> int:
        key = plant, drive, name
        known = self._quantities.get(key)
        if known is None:
            known = self._quantities[key] = self._number(
                "quantity", ("plant", "drive", "name"), (self._plant(plant), drive, name)
            )
        return known

    def _remark(self, *key: str) -> int:
        unit, quality, text, note = key
        known = self._remarks.get((unit, quality, text, note))
        if known is None:
            if len(self._remarks) >= _MOST_REMARKS:
                self._remarks.clear()
            names = "unit", "quality", "text", "note"
            known = self._remarks[unit, quality, text, note] = self._number("remark", names, key)
        return known

    def _number(self, table: str, names: Sequence[str], key: Sequence[object]) -> int:
        """Return the id of a row, which is created if missing."""
        where = " AND ".join(f"{name} = %s" for name in names)
        find = f"SELECT id FROM {table} WHERE {where}"  # noqa: S608 - our own names
        if not (found := self._database.all(find, key)):
            self._database.all(
                f"INSERT INTO {table} ({', '.join(names)}) VALUES ({', '.join(['%s'] * len(names))}) "  # noqa: S608
                "ON CONFLICT DO NOTHING",
                key,
            )
            found = self._database.all(find, key)
        return int(found[0][0])

    def _write_plant(self, said: PlantState) -> None:
        moment = self._database.moment()
        places = {"state": "%s", "version": "%s", "file": "%s", "file_sha256": "%s", "file_read": moment}
        given = {name: value for name, value in zip(places, said[1:], strict=True) if value is not None}
        settings = ", ".join(f"{name} = {places[name]}" for name in given)
        plant = self._plant(said.plant)
        if given:
            self._database.all(
                f"UPDATE plant SET {settings} WHERE id = %s",  # noqa: S608 - our own names
                (*given.values(), plant),
            )

    def _write_alarms(self, standing: StandingAlarms) -> None:
        database, plant, moment = self._database, self._plant(standing.plant), self._database.moment()
        for each in standing.alarms:
            database.all(
                "INSERT INTO alarm (plant, id, rule, drive, text, since, over, times, acknowledged_by, acknowledged) "  # noqa: S608
                f"VALUES (%s, %s, %s, %s, %s, {moment}, {moment}, %s, %s, {moment}) ON CONFLICT (plant, id) DO UPDATE "
                "SET text = excluded.text, over = excluded.over, times = excluded.times, "
                "acknowledged_by = excluded.acknowledged_by, acknowledged = excluded.acknowledged, ended = NULL",
                (plant, *each),
            )
        others = "".join(" AND id <> %s" for _ in standing.alarms)
        database.all(
            f"UPDATE alarm SET ended = {moment} WHERE plant = %s AND ended IS NULL{others}",  # noqa: S608
            (round(time.time() * 1000), plant, *(each.id for each in standing.alarms)),
        )
