"""The reader of a history, usable while a server writes it, and without a server."""

from __future__ import annotations

import sqlite3
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NamedTuple, Self, TypeAlias

from drivecomm.client import parsed
from drivecomm.errors import FileFormatError, UsageError, suggestion
from drivecomm.line import FRESH
from drivecomm.server import Event
from drivecomm.server.history.records import FaultLogEntry, PastCommand, PastEvent, PastValue, StoredQuantity, value_of
from drivecomm.server.history.schema import open_for_reading
from drivecomm.server.history.thinning import CoursePoint, thinned

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from drivecomm.line import ResultQuality

_EVER = 2**62
_Remark: TypeAlias = "tuple[ResultQuality, str, str]"
_GOOD: _Remark = ("good", "", "")


class _Key(NamedTuple):
    """A quantity as stored in the file, with its power of ten; None for texts."""

    id: int
    quantity: StoredQuantity
    exponent: int | None


class _Row(NamedTuple):
    """A value as stored in the file."""

    row: int
    key: _Key
    time_ms: int
    whole: int | str | None
    raw: int | str | None
    remark: _Remark
    age_ms: int | None


class History:
    """An open history; a context manager that closes it. Used only in the thread that opened it.

    Times are in seconds since 1970. Ranges include both limits; a missing limit leaves that side open. Row numbers
    increase in the order in which values came; times step back where the clock was set back. Raises FileFormatError if
    the file is missing or cannot be read, as its methods do.
    """

    def __init__(self, file: Path) -> None:
        self.file = file
        if not file.is_file():
            raise FileFormatError(f"{file}: no such history; a server writes it while it runs")
        with self._told():
            self._connection = open_for_reading(file)
        self._execute = self._connection.execute

    def close(self) -> None:
        """Close the file."""
        self._connection.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def drives(self) -> list[str]:
        """Return the drives that have values, in the order of their first values."""
        return list(dict.fromkeys(key.quantity.drive for key in self._keys(None, None)))

    def quantities(self, drive: str | None = None) -> list[StoredQuantity]:
        """Return the quantities that have values, drive by drive, in the order of their first values."""
        found = [key.quantity for key in self._keys(drive, None) if key.quantity.address]
        order = list(dict.fromkeys(each.drive for each in found))
        return sorted(dict.fromkeys(found), key=lambda each: order.index(each.drive))

    def values(
        self,
        drive: str | None = None,
        name: str | None = None,
        from_s: float | None = None,
        to_s: float | None = None,
    ) -> Iterator[PastValue]:
        """Yield values in the order in which they came; a gap is a value of quality bad with the reason.

        drive, name: only values of this drive and quantity. Raises UsageError for one that the history does not have.
        """
        keys = self._known_keys(drive, name)
        yield from map(_past_value, self._with_gaps(keys, _ms(from_s, -_EVER), _ms(to_s, _EVER)))

    def since(self, row: int) -> Iterator[PastValue]:
        """Yield the values of all drives after a row, for a reader that forwards them without gaps."""
        yield from map(_past_value, self._rows(None, -_EVER, _EVER, row + 1))

    def last_row(self) -> int:
        """Return the row of the latest value, 0 without one."""
        found = self._all("SELECT max(row) FROM recent UNION ALL SELECT max(last_row) FROM segment")
        return max((row for (row,) in found if row is not None), default=0)

    def points(
        self, drive: str, name: str, from_s: float | None = None, to_s: float | None = None, points: int = 500
    ) -> list[CoursePoint]:
        """Return the curve of a quantity in about `points` points, in the order of time.

        Each period contributes its first and last value, its lowest and highest, and where gaps begin and end: in a gap
        the value is None. Raises UsageError as `values` does.
        """
        begin, end = self._extent()
        begin, end = begin if from_s is None else _ms(from_s, 0), end if to_s is None else _ms(to_s, 0)
        found = (
            CoursePoint(
                each.time_ms / 1000,
                value_of(each.whole, each.key.exponent) if each.remark[0] in FRESH else None,
                each.remark[0],
            )
            for each in self._with_gaps(self._known_keys(drive, name), begin, end)
        )
        return list(thinned(found, begin / 1000, end / 1000, points))

    def latest(self, drive: str | None = None) -> list[PastValue]:
        """Return the latest value of each quantity."""
        found: dict[tuple[str, str], _Row] = {}
        for key in self._known_keys(drive, None):
            latest = self._latest(key)
            name = (key.quantity.drive, key.quantity.name)
            if latest and (name not in found or latest.row > found[name].row):
                found[name] = latest
        return list(map(_past_value, found.values()))

    def events(
        self,
        drive: str | None = None,
        kind: str | None = None,
        from_s: float | None = None,
        to_s: float | None = None,
        limit: int | None = None,
    ) -> list[PastEvent]:
        """Return events, the oldest first. limit: only the latest N."""
        found = self._logged("event", {"drive": drive, "kind": kind}, from_s, to_s, limit)
        return [_past_event(*each) for each in found]

    def commands(
        self,
        drive: str | None = None,
        from_s: float | None = None,
        to_s: float | None = None,
        limit: int | None = None,
    ) -> list[PastCommand]:
        """Return commands, the oldest first. limit: only the latest N."""
        return [_past_command(*each) for each in self._logged("command", {"drive": drive}, from_s, to_s, limit)]

    def events_since(self, row: int, limit: int) -> list[PastEvent]:
        """Return the first events after a row, for a reader that forwards them without gaps."""
        return [
            _past_event(*each)
            for each in self._all("SELECT * FROM event WHERE row > ? ORDER BY row LIMIT ?", (row, limit))
        ]

    def commands_since(self, row: int, limit: int) -> list[PastCommand]:
        """Return the first commands after a row, for a reader that forwards them without gaps."""
        return [
            _past_command(*each)
            for each in self._all("SELECT * FROM command WHERE row > ? ORDER BY row LIMIT ?", (row, limit))
        ]

    def last_rows(self) -> tuple[int, int]:
        """Return the rows of the latest event and of the latest command, 0 without one."""
        event, command = (self._all(f"SELECT max(row) FROM {table}")[0][0] for table in ("event", "command"))  # noqa: S608
        return event or 0, command or 0

    def fault_logs(
        self,
        drive: str | None = None,
        from_s: float | None = None,
        to_s: float | None = None,
        limit: int | None = None,
    ) -> list[FaultLogEntry]:
        """Return the entries of the drives' fault logs, in the order in which they were read."""
        return [
            FaultLogEntry(
                row=row, time_s=time_ms / 1000, drive=of, place=place, address=address, value=value, text=text
            )
            for row, time_ms, of, place, address, value, text in self._logged(
                "fault_log", {"drive": drive}, from_s, to_s, limit
            )
        ]

    @contextmanager
    def _told(self) -> Iterator[None]:
        try:
            yield
        except sqlite3.Error as error:
            raise FileFormatError(f"{self.file}: cannot be read as a history: {error}") from error

    def _all(self, question: str, values: Sequence[object] = ()) -> list[Any]:
        with self._told():
            return self._execute(question, values).fetchall()

    def _logged(
        self,
        table: str,
        wanted: dict[str, str | None],
        from_s: float | None,
        to_s: float | None,
        limit: int | None,
    ) -> list[Any]:
        said = {column: each for column, each in wanted.items() if each is not None}
        conditions = "".join(f" AND {column} = ?" for column in said)
        found = self._all(
            f"SELECT * FROM {table} WHERE time_ms BETWEEN ? AND ?{conditions} "  # noqa: S608 - fixed names only
            "ORDER BY row DESC LIMIT ?",
            (_ms(from_s, -_EVER), _ms(to_s, _EVER), *said.values(), -1 if limit is None else limit),
        )
        return found[::-1]

    def _keys(self, drive: str | None, name: str | None) -> list[_Key]:
        found = self._all("SELECT id, drive, name, address, unit, exponent FROM quantity ORDER BY id")
        return [
            _Key(number, StoredQuantity(*rest), exponent)
            for number, *rest, exponent in found
            if drive in (None, rest[0]) and name in (None, rest[1])
        ]

    def _known_keys(self, drive: str | None, name: str | None) -> list[_Key]:
        keys = self._keys(drive, name)
        if not keys and drive is not None:
            drives = self.drives()
            if drive not in drives:
                raise UsageError(f"{self.file} has no drive {drive!r}; {suggestion(drive, drives, 'it has')}")
            names = dict.fromkeys(key.quantity.name for key in self._keys(drive, None))
            raise UsageError(f"{self.file} has no {name!r} of {drive}; {suggestion(name, names, 'it has')}")
        return keys

    def _extent(self) -> tuple[int, int]:
        """Return the earliest and the latest time of all values, in milliseconds."""
        found = self._all(
            "SELECT min(start_ms), max(end_ms) FROM segment UNION ALL SELECT min(time_ms), max(time_ms) FROM recent"
        )
        begins = [begin for begin, _ in found if begin is not None]
        ends = [end for _, end in found if end is not None]
        return min(begins, default=0), max(ends, default=0)

    def _with_gaps(self, keys: Sequence[_Key], begin: int, end: int) -> Iterator[_Row]:
        """Yield rows; each gap is a row for each quantity, with the reason."""
        gaps = self._all(
            "SELECT before_row, time_ms, text FROM gap WHERE time_ms BETWEEN ? AND ? ORDER BY row", (begin, end)
        )
        named = {(key.quantity.drive, key.quantity.name): key for key in keys}
        missing = [
            _Row(before, key, time_ms, None, None, ("bad", "", text), None)
            for before, time_ms, text in gaps
            for key in named.values()
        ]
        for row in self._rows(keys, begin, end, 0):
            while missing and missing[0].row <= row.row:
                yield missing.pop(0)
            yield row
        yield from missing

    def _rows(self, keys: Sequence[_Key] | None, begin: int, end: int, first: int) -> Iterator[_Row]:
        """Yield rows from the first on, segment by segment, so that a slow reader does not block the writer.

        keys: only these quantities; None for all, including those that appear meanwhile.
        """
        wanted = "" if keys is None else f" AND quantity IN ({','.join(str(key.id) for key in keys)})"
        while True:
            with self._told(), self._one_moment():
                by_id = {key.id: key for key in (self._keys(None, None) if keys is None else keys)}
                segment = self._execute(
                    "SELECT number, first_row, last_row, start_ms FROM segment "
                    "WHERE last_row >= ? AND start_ms <= ? AND end_ms >= ? ORDER BY number LIMIT 1",
                    (first, end, begin),
                ).fetchone()
                remarks = self._remarks(segment[0] if segment else None)
                if segment:
                    number, its_first, its_last, start = segment
                    rows = self._execute(
                        "SELECT row + ?, quantity, time_ms + ?, whole, raw, remark, age_ms FROM value "  # noqa: S608
                        f"WHERE segment = ? AND row >= ? AND time_ms BETWEEN ? AND ?{wanted} ORDER BY row",
                        (its_first, start, number, first - its_first, begin - start, end - start),
                    ).fetchall()
                else:
                    rows = self._execute(
                        f"SELECT * FROM recent WHERE row >= ? AND time_ms BETWEEN ? AND ?{wanted} ORDER BY row",  # noqa: S608
                        (first, begin, end),
                    ).fetchall()
            for row, quantity, time_ms, whole, raw, remark, age_ms in rows:
                yield _Row(row, by_id[quantity], time_ms, whole, raw, remarks.get(remark, _GOOD), age_ms)
            if not segment:
                return
            first = its_last + 1

    @contextmanager
    def _one_moment(self) -> Iterator[None]:
        """Read from one snapshot of the file for the duration of the block, whatever is written meanwhile."""
        self._execute("BEGIN")
        try:
            yield
        finally:
            self._execute("ROLLBACK")

    def _remarks(self, segment: int | None) -> dict[int, _Remark]:
        """Return the remarks on values, of a segment or of the values that are in no segment yet."""
        where = "segment = ?" if segment is not None else "segment > (SELECT coalesce(max(number), 0) FROM segment)"
        found = self._execute(
            f"SELECT number, quality, text, note FROM remark WHERE {where}",  # noqa: S608 - fixed text only
            () if segment is None else (segment,),
        )
        return {number: (quality, text, note) for number, quality, text, note in found}

    def _latest(self, key: _Key) -> _Row | None:
        with self._told(), self._one_moment():
            found = self._execute(
                "SELECT * FROM recent WHERE quantity = ? ORDER BY row DESC LIMIT 1", (key.id,)
            ).fetchone()
            if found:
                row, _, time_ms, whole, raw, remark, age_ms = found
                return _Row(row, key, time_ms, whole, raw, self._remarks(None).get(remark, _GOOD), age_ms)
            for segment, first, start in self._execute(
                "SELECT number, first_row, start_ms FROM segment ORDER BY number DESC"
            ).fetchall():
                found = self._execute(
                    "SELECT row, time_ms, whole, raw, remark, age_ms FROM value WHERE segment = ? AND quantity = ? "
                    "ORDER BY row DESC LIMIT 1",
                    (segment, key.id),
                ).fetchone()
                if found:
                    row, time_ms, whole, raw, remark, age_ms = found
                    said = self._remarks(segment).get(remark, _GOOD)
                    return _Row(row + first, key, time_ms + start, whole, raw, said, age_ms)
        return None


def _ms(time_s: float | None, otherwise: int) -> int:
    return otherwise if time_s is None else round(time_s * 1000)


def _past_event(row: int, time_ms: int, *rest: Any) -> PastEvent:
    said = dict(zip(("number", "kind", "text", "drive", "line", "who"), rest, strict=True))
    return PastEvent(row=row, event=Event(time_s=time_ms / 1000, **said))


def _past_command(row: int, time_ms: int, done_ms: int, *rest: Any) -> PastCommand:
    names = ("id", "who", "door", "drive", "verb", "arguments", "outcome", "text")
    said = {name: parsed(each) if name == "arguments" else each for name, each in zip(names, rest, strict=True)}
    return PastCommand(row=row, time_s=time_ms / 1000, done_s=done_ms / 1000, **said)


def _past_value(row: _Row) -> PastValue:
    quantity, (quality, text, note) = row.key.quantity, row.remark
    return PastValue(
        row=row.row,
        time_s=row.time_ms / 1000,
        drive=quantity.drive,
        name=quantity.name,
        address="" if row.whole is None else quantity.address,
        value=value_of(row.whole, row.key.exponent),
        unit="" if row.whole is None else quantity.unit,
        raw=row.whole if row.raw is None else row.raw,
        text=text,
        quality=quality,
        note=note,
        source_s=None if row.age_ms is None else (row.time_ms - row.age_ms) / 1000,
    )
