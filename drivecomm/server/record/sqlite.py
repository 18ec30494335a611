"""A record in an SQLite file, for a site without a database server and with one recorder."""

from __future__ import annotations

import os
import sqlite3
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

from drivecomm.errors import FileFormatError, LinkDownError
from drivecomm.server.record.tables import TABLES, statements, upgrade

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from drivecomm.server.record.tables import Kind

_TYPES: Mapping[Kind, str] = {
    "identity": "integer PRIMARY KEY",
    "integer": "integer",
    "time": "integer",
    "number": "numeric",
    "text": "text",
}
_BUSY_S = 10.0


class SqliteDatabase:
    """Open file, created if necessary with access for its owner only; its times are milliseconds since 1970.

    Raises FileFormatError for another file, UsageError for tables of a newer drivecomm, LinkDownError if it cannot be
    opened.
    """

    def __init__(self, path: Path) -> None:
        self.place = str(path)
        with suppress(OSError):
            # If this fails, SQLite reports the reason.
            os.close(os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_CLOEXEC", 0), 0o600))
        with self._reached():
            self._connection = sqlite3.connect(path, timeout=_BUSY_S, isolation_level=None, check_same_thread=False)
        try:
            self._make_tables()
        except BaseException:
            self._connection.close()
            raise

    def all(self, question: str, values: Sequence[object] = ()) -> list[tuple[Any, ...]]:
        """Execute a statement, with %s for each value, and return its rows."""
        with self._reached():
            return self._connection.execute(question.replace("%s", "?"), tuple(values)).fetchall()

    def add(self, table: str, rows: Sequence[tuple[object, ...]]) -> int:
        """Insert the rows whose key does not exist yet, and return their number."""
        places = ", ".join("?" * len(TABLES[table].columns))
        before = self._connection.total_changes
        with self._reached():
            self._connection.executemany(
                f"INSERT OR IGNORE INTO {table} VALUES ({places})",  # noqa: S608 - our own names
                rows,
            )
        return self._connection.total_changes - before

    @contextmanager
    def transaction(self) -> Iterator[None]:
        """Commit all statements of the block, or none."""
        self.all("BEGIN IMMEDIATE")
        try:
            yield
            self.all("COMMIT")
        except BaseException:
            if self._connection.in_transaction:
                self._connection.rollback()
            raise

    def moment(self) -> str:
        """Return SQL that converts a time given as a value."""
        return "%s"

    def milliseconds(self, column: str) -> str:
        """Return SQL that reads a time in milliseconds."""
        return column

    def close(self) -> None:
        """Close the file."""
        self._connection.close()

    def _make_tables(self) -> None:
        # An acknowledged value must be on the disk.
        for setting in ("journal_mode = WAL", "synchronous = FULL"):
            self.all(f"PRAGMA {setting}")
        with self.transaction():
            tables = {name for (name,) in self.all("SELECT name FROM sqlite_master WHERE type = 'table'")}
            if "record" in tables:
                found = self.all("SELECT max(version) FROM record")[0][0]
                for statement in upgrade(self.place, found, "file"):
                    self.all(statement)
            elif tables:
                raise FileFormatError(f"{self.place}: is a database of another program; name another file")
            else:
                for statement in statements(_TYPES):
                    # Stores the values of a quantity next to each other.
                    self.all(statement + " WITHOUT ROWID" * statement.startswith("CREATE TABLE value"))

    @contextmanager
    def _reached(self) -> Iterator[None]:
        try:
            yield
        except (sqlite3.InterfaceError, sqlite3.DataError, OverflowError) as error:
            raise ValueError(str(error)) from error
        except sqlite3.DatabaseError as error:
            raise LinkDownError(f"{self.place}: {error}") from error
