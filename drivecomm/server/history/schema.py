"""The tables of a history, and the opening of its file.

Values arrive in the order of time and are read by quantity, and both must be fast. New values are added to `recent`.
When `recent` holds ROWS_A_SEGMENT rows, they move into `value` as one segment, sorted by quantity. So the disk writes
every row twice, sequentially, instead of scattered pages for each value; the curve of a quantity is one short block of
each segment; and old values are deleted as whole segments. Within a segment, rows and times count from its beginning,
and each remark on values (quality, text and note) is stored once.
"""

from __future__ import annotations

import os
import sqlite3
import stat
from contextlib import suppress
from typing import TYPE_CHECKING

from drivecomm.errors import FileFormatError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

ROWS_A_SEGMENT = 100_000

VERSION = 1
"""Version of the tables of a history, kept in its file."""

UPGRADES: Mapping[int, str] = {}
"""SQL that upgrades the tables from each earlier version to the next one."""

_APPLICATION = 0x64726976
_BUSY_S = 5.0

_TABLES = """
CREATE TABLE quantity (
    id INTEGER PRIMARY KEY, drive TEXT, name TEXT, address TEXT, unit TEXT, exponent INTEGER);
CREATE TABLE segment (
    number INTEGER PRIMARY KEY, first_row INTEGER, last_row INTEGER, start_ms INTEGER, end_ms INTEGER);
CREATE TABLE recent (
    row INTEGER PRIMARY KEY, quantity INTEGER, time_ms INTEGER, whole, raw, remark INTEGER, age_ms INTEGER);
CREATE TABLE value (
    segment INTEGER, quantity INTEGER, row INTEGER, time_ms INTEGER, whole, raw, remark INTEGER, age_ms INTEGER,
    PRIMARY KEY (segment, quantity, row)) WITHOUT ROWID;
CREATE TABLE remark (
    segment INTEGER, number INTEGER, quality TEXT, text TEXT, note TEXT,
    PRIMARY KEY (segment, number)) WITHOUT ROWID;
CREATE TABLE gap (row INTEGER PRIMARY KEY, before_row INTEGER, time_ms INTEGER, end_ms INTEGER, text TEXT);
CREATE TABLE event (
    row INTEGER PRIMARY KEY, time_ms INTEGER, number INTEGER, kind TEXT, text TEXT, drive TEXT, line TEXT, who TEXT);
CREATE TABLE command (
    row INTEGER PRIMARY KEY, time_ms INTEGER, done_ms INTEGER, id TEXT, who TEXT, door TEXT, drive TEXT, verb TEXT,
    arguments TEXT, outcome TEXT, text TEXT);
CREATE TABLE fault_log (
    row INTEGER PRIMARY KEY, time_ms INTEGER, drive TEXT, place INTEGER, address TEXT, value TEXT, text TEXT);
CREATE INDEX event_time ON event (time_ms);
CREATE INDEX command_time ON command (time_ms);
CREATE INDEX fault_log_time ON fault_log (time_ms);
"""


def open_for_writing(path: Path) -> sqlite3.Connection:
    """Open a history for its owner alone; create a missing one, and upgrade the tables of an earlier drivecomm.

    Raises FileFormatError for a file of another program, and sqlite3.Error.
    """
    with suppress(OSError):
        # If this fails, SQLite reports the error. The side files of SQLite get the same permissions as the file.
        _be_private(path)
    connection = sqlite3.connect(path, timeout=_BUSY_S, isolation_level=None, check_same_thread=False)
    try:
        found = _version_in(connection, path)
        if not found:
            # Needed to return pages to the file system later.
            connection.execute("PRAGMA auto_vacuum = INCREMENTAL")
        connection.execute("PRAGMA journal_mode = WAL")
        # Committed data survive the end of the process in any mode. NORMAL avoids a wait for the disk at each commit:
        # a power failure may lose the latest commits, but never damages the file.
        connection.execute("PRAGMA synchronous = NORMAL")
        connection.execute("PRAGMA journal_size_limit = 8388608")
        if not found:
            connection.executescript(
                f"BEGIN; {_TABLES} PRAGMA application_id = {_APPLICATION}; PRAGMA user_version = {VERSION}; COMMIT;"
            )
        for version in range(found or VERSION, VERSION):
            # One transaction per version: if the process is killed, the tables stay whole in the version before.
            connection.executescript(f"BEGIN; {UPGRADES[version]} PRAGMA user_version = {version + 1}; COMMIT;")
    except BaseException:
        connection.close()
        raise
    return connection


def _be_private(path: Path) -> None:
    """Create a file that only its owner can access; remove the permissions for other users from an existing file."""
    os.close(os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_CLOEXEC", 0), 0o600))
    for each in (path, _wal_of(path), path.with_name(path.name + "-shm")):
        if each.exists() and (mode := stat.S_IMODE(each.stat().st_mode)) & 0o007:
            each.chmod(mode & ~0o007)


def open_for_reading(path: Path) -> sqlite3.Connection:
    """Open a history without changing it. Raises FileFormatError for a file of another program, and sqlite3.Error."""
    place = f"{path.resolve().as_uri()}?mode=ro"
    # In a read-only folder, SQLite opens a file only as immutable, and only if no process writes the file.
    for also in ("", "&immutable=1"):
        connection = sqlite3.connect(place + also, uri=True, timeout=_BUSY_S, isolation_level=None)
        try:
            _must_be_current(connection, path)
        except sqlite3.OperationalError as error:
            connection.close()
            if also or code_of(error) != sqlite3.SQLITE_CANTOPEN or _wal_of(path).exists():
                raise
        except BaseException:
            connection.close()
            raise
        else:
            return connection
    raise AssertionError(path)


def is_damaged(error: sqlite3.Error) -> bool:
    """Return whether an error means that the file itself is damaged."""
    return code_of(error) in (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB)


def code_of(error: sqlite3.Error) -> int:
    """Return the primary result code of an SQLite error, 0 without one."""
    return (getattr(error, "sqlite_errorcode", None) or 0) & 0xFF


def move_aside(path: Path, suffix: str) -> Path:
    """Rename a file and the side files of SQLite; return its new path. Raises OSError."""
    target = path.with_name(f"{path.name}.{suffix}")
    path.replace(target)
    for end in ("-wal", "-shm"):
        beside = path.with_name(path.name + end)
        if beside.exists():
            beside.replace(target.with_name(target.name + end))
    return target


def _wal_of(path: Path) -> Path:
    return path.with_name(path.name + "-wal")


def _must_be_current(connection: sqlite3.Connection, path: Path) -> None:
    found = _version_in(connection, path)
    if not found:
        raise FileFormatError(f"{path}: is not a history of drivecomm; name the file that a server writes")
    if found < VERSION:
        raise FileFormatError(
            f"{path}: was written by an older drivecomm (format {found}, this one reads {VERSION}); "
            "start its server once with this drivecomm, which upgrades it"
        )


def _version_in(connection: sqlite3.Connection, path: Path) -> int:
    """Return the version of the tables in this file; 0 for an empty file. Raises FileFormatError for another file."""
    application = connection.execute("PRAGMA application_id").fetchone()[0]
    version: int = connection.execute("PRAGMA user_version").fetchone()[0]
    if application == _APPLICATION:
        if version > VERSION:
            raise FileFormatError(
                f"{path}: was written by a newer drivecomm (format {version}, this one knows {VERSION}); "
                "update drivecomm, or name another file"
            )
        return version
    if connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]:
        raise FileFormatError(f"{path}: is a database of another program; name another file for the history")
    return 0
