"""A history file as opened by its writer: batches are written atomically, and old data are deleted."""

from __future__ import annotations

from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

from drivecomm.client import json_text, plain
from drivecomm.errors import in_one_line
from drivecomm.line import FRESH
from drivecomm.server.history.records import whole_and_exponent
from drivecomm.server.history.schema import ROWS_A_SEGMENT, open_for_writing

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from drivecomm.protocol import Reading
    from drivecomm.server import Caller, CommandAnswer, CommandRequest, CurrentValue, Event

_FULL = 0.95
"""Share of the size limit above which old data are deleted."""

_PAGES_AT_ONCE = 500
_GOOD = ("good", "", "")
_KEPT_BY_TIME = ("event", "command", "fault_log", "gap")


class CommandDone(NamedTuple):
    """A command with its caller and outcome, and the times of both."""

    caller: Caller
    command: CommandRequest
    answer: CommandAnswer
    asked_s: float
    done_s: float


class FaultLogRead(NamedTuple):
    """The fault log of a drive as read at a time, the newest entry first."""

    drive: str
    entries: Sequence[Reading]
    time_s: float


class Gap(NamedTuple):
    """A period with missing values, and the reason."""

    from_s: float
    to_s: float
    text: str


JournalEntry: TypeAlias = "Event | CommandDone | FaultLogRead | Gap"
_UNFIT = (ValueError, TypeError, ArithmeticError)


class HistoryFile:
    """An open history file. Raises FileFormatError and sqlite3.Error, as its methods do; after an error, close it."""

    def __init__(self, path: Path) -> None:
        self._connection = open_for_writing(path)
        self._execute = self._connection.execute
        self._segment = self._row = 1
        self._recent = 0
        self._quantities: dict[tuple[object, ...], int] = {}
        self._remarks: dict[tuple[str, str, str], int] = {}
        try:
            self._load()
        except BaseException:
            self._connection.close()
            raise

    def close(self) -> None:
        """Close the file; all committed data are in it then, without side files."""
        self._connection.close()

    @property
    def last_row(self) -> int:
        """The row of the latest value, 0 before the first one."""
        return self._row - 1

    def latest_s(self) -> float | None:
        """Return the time of the latest value, or None before the first one."""
        found = self._execute("SELECT time_ms FROM recent ORDER BY row DESC LIMIT 1").fetchone()
        found = found or self._execute("SELECT end_ms FROM segment ORDER BY number DESC LIMIT 1").fetchone()
        return found[0] / 1000 if found else None

    def add(self, values: Sequence[CurrentValue], others: Sequence[JournalEntry]) -> None:
        """Add a batch atomically; items that cannot be stored, such as those with an invalid time, are dropped."""
        try:
            self._add(values, others)
        except _UNFIT:
            for value in values:
                with suppress(*_UNFIT):
                    self._add([value], [])
            for other in others:
                with suppress(*_UNFIT):
                    self._add([], [other])

    def _add(self, values: Sequence[CurrentValue], others: Sequence[JournalEntry]) -> None:
        with self._transaction():
            for other in others:
                self._add_other(other)
            rows = [self._row_of(self._row + place, value) for place, value in enumerate(values)]
            self._connection.executemany("INSERT INTO recent VALUES (?, ?, ?, ?, ?, ?, ?)", rows)
        self._row += len(rows)
        self._recent += len(rows)

    def sort(self) -> bool:
        """Move recent values into a new segment if there are enough of them; return whether it was done."""
        if self._recent < ROWS_A_SEGMENT:
            return False
        with self._transaction():
            first, last, start, end = self._execute(
                "SELECT min(row), max(row), min(time_ms), max(time_ms) FROM recent"
            ).fetchone()
            self._execute("INSERT INTO segment VALUES (?, ?, ?, ?, ?)", (self._segment, first, last, start, end))
            self._execute(
                "INSERT INTO value SELECT ?, quantity, row - ?, time_ms - ?, whole, raw, remark, age_ms "
                "FROM recent ORDER BY quantity, row",
                (self._segment, first, start),
            )
            self._execute("DELETE FROM recent")
        self._segment += 1
        self._recent = 0
        self._remarks.clear()
        return True

    def drop_oldest(self, *, before_s: float, megabytes: float) -> bool:
        """Delete one portion of data that is too old or exceeds the size limit; return whether more may be left.

        before_s: data from before this time is too old.
        """
        limit, before_ms = megabytes * 1e6, round(before_s * 1000)
        pages, free, size = (
            self._execute(f"PRAGMA {each}").fetchone()[0] for each in ("page_count", "freelist_count", "page_size")
        )
        # The latest segment stays, because row numbers continue from it.
        oldest = self._execute(
            "SELECT number, end_ms FROM segment WHERE number < ? ORDER BY number LIMIT 1", (self._segment - 1,)
        ).fetchone()
        too_large = (pages - free) * size > limit * _FULL
        if oldest and (too_large or oldest[1] < before_ms):
            with self._transaction():
                self._execute("DELETE FROM value WHERE segment = ?", oldest[:1])
                self._execute("DELETE FROM remark WHERE segment = ?", oldest[:1])
                self._execute("DELETE FROM segment WHERE number = ?", oldest[:1])
            return True
        with self._transaction():
            if too_large:
                self._execute("DELETE FROM event WHERE row IN (SELECT row FROM event ORDER BY row LIMIT 10000)")
            for table in _KEPT_BY_TIME:
                self._execute(f"DELETE FROM {table} WHERE time_ms < ?", (before_ms,))  # noqa: S608 - fixed names only
        if free and pages * size > limit:
            self._execute(f"PRAGMA incremental_vacuum({_PAGES_AT_ONCE})").fetchall()
            return True
        return False

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        self._execute("BEGIN IMMEDIATE")
        try:
            yield
            self._execute("COMMIT")
        except BaseException:
            if self._connection.in_transaction:
                self._execute("ROLLBACK")
                # The cached quantities and remarks may include some that were rolled back.
                self._load()
            raise

    def _load(self) -> None:
        """Load the current row, segment, quantities and remarks from the file."""
        self._segment, sorted_row = self._execute(
            "SELECT coalesce(max(number), 0) + 1, coalesce(max(last_row), 0) FROM segment"
        ).fetchone()
        self._recent, recent_row = self._execute("SELECT count(*), coalesce(max(row), 0) FROM recent").fetchone()
        self._row = max(sorted_row, recent_row) + 1
        found = self._execute("SELECT drive, name, address, unit, exponent, id FROM quantity")
        self._quantities = {row[:-1]: row[-1] for row in found}
        found = self._execute("SELECT quality, text, note, number FROM remark WHERE segment = ?", (self._segment,))
        self._remarks = {row[:-1]: row[-1] for row in found}

    def _row_of(self, row: int, value: CurrentValue) -> tuple[object, ...]:
        reading, quality = value.reading, value.quality
        if reading is None:
            quantity = self._quantity(value.drive, value.name, "", "", None)
            return row, quantity, round(value.time_s * 1000), None, None, self._remark(quality, "", value.cause), None
        whole, exponent = whole_and_exponent(reading.value)
        quantity = self._quantity(value.drive, value.name, reading.parameter, reading.unit, exponent)
        remark = self._remark(quality, reading.text, value.remark)
        # The raw number mostly equals the value without its decimal point, and is then left out.
        raw = None if reading.raw == whole else reading.raw
        if quality in FRESH:
            return row, quantity, round(reading.time_s * 1000), whole, raw, remark, None
        time_ms = round(value.time_s * 1000)
        return row, quantity, time_ms, whole, raw, remark, time_ms - round(reading.time_s * 1000)

    def _quantity(self, *key: str | int | None) -> int:
        known = self._quantities.get(key)
        if known is None:
            added = self._execute("INSERT INTO quantity VALUES (NULL, ?, ?, ?, ?, ?)", key)
            known = self._quantities[key] = added.lastrowid or 0
        return known

    def _remark(self, quality: str, text: str, note: str) -> int:
        key = (quality, text, note)
        if key == _GOOD:
            return 0
        known = self._remarks.get(key)
        if known is None:
            known = self._remarks[key] = len(self._remarks) + 1
            self._execute("INSERT INTO remark VALUES (?, ?, ?, ?, ?)", (self._segment, known, *key))
        return known

    def _add_other(self, other: JournalEntry) -> None:
        if isinstance(other, Gap):
            gap = (self._row, round(other.from_s * 1000), round(other.to_s * 1000), other.text)
            self._execute("INSERT INTO gap VALUES (NULL, ?, ?, ?, ?)", gap)
        elif isinstance(other, CommandDone):
            caller, command, answer, asked_s, done_s = other
            self._execute(
                "INSERT INTO command VALUES (NULL, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
                (
                    *(round(asked_s * 1000), round(done_s * 1000), answer.id, caller.name, caller.door),
                    *(command.drive, command.verb, json_text(plain(command.arguments)), answer.outcome),
                    "" if answer.error is None else in_one_line(answer.error),
                ),
            )
        elif isinstance(other, FaultLogRead):
            self._connection.executemany(
                "INSERT INTO fault_log VALUES (NULL, ?, ?, ?, ?, ?, ?)",
                [
                    (round(other.time_s * 1000), other.drive, place, entry.parameter, str(entry.value), entry.text)
                    for place, entry in enumerate(other.entries, 1)
                ],
            )
        else:
            self._execute(
                "INSERT INTO event VALUES (NULL, ?, ?, ?, ?, ?, ?, ?)",
                (
                    *(round(other.time_s * 1000), other.number, other.kind, other.text),
                    *(other.drive, other.line, other.who),
                ),
            )
