"""The database of a record: a PostgreSQL URL or an SQLite file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from drivecomm.errors import UsageError

if TYPE_CHECKING:
    from drivecomm.server.record.database import Database

_POSTGRES = ("postgresql://", "postgres://")
_SQLITE = "sqlite:"


def open_record(place: str, *, insecure: bool = False) -> Database:
    """Open the database of a record. place: postgresql://..., sqlite:FILE or FILE.

    Raises UsageError for an invalid place, LinkDownError if the database cannot be reached.
    """
    if place.startswith(_POSTGRES):
        try:
            from drivecomm.server.record.postgres import PostgresDatabase
        except ImportError as error:
            raise UsageError(
                f'a record in PostgreSQL needs more packages ({error}); run pip install "drivecomm[record]"'
            ) from error
        return PostgresDatabase(place, insecure=insecure)
    file = place.removeprefix(_SQLITE)
    if "://" in place or not file:
        raise UsageError("the record can be in postgresql://USER@HOST/DATABASE or in a file; write one of them")
    from drivecomm.server.record.sqlite import SqliteDatabase

    return SqliteDatabase(Path(file))
