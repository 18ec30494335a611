"""The interface of a record's database. Times are milliseconds since 1970 here, whatever the database stores."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from collections.abc import Sequence
    from contextlib import AbstractContextManager

TO_THE_END_MS = 253_402_300_799_000
"""The last millisecond that all databases and Python can represent: the end of the year 9999."""


class Database(Protocol):
    """Open database with the tables of a record, used by one thread.

    Methods raise LinkDownError if the database can no longer be reached; it must then be closed and opened again. They
    raise ValueError for content that the database cannot store.
    """

    place: str
    """Name for messages, without user and password."""

    def all(self, question: str, values: Sequence[object] = ()) -> list[tuple[Any, ...]]:
        """Execute a statement, with %s for each value, and return its rows."""

    def add(self, table: str, rows: Sequence[tuple[object, ...]]) -> int:
        """Insert the rows whose key does not exist yet, and return their number. Numbers are given as texts."""

    def transaction(self) -> AbstractContextManager[object]:
        """Commit all statements of the block, or none. A commit survives a power cut."""

    def moment(self) -> str:
        """Return SQL that converts a time given as a value."""

    def milliseconds(self, column: str) -> str:
        """Return SQL that reads a time in milliseconds."""

    def close(self) -> None:
        """Close the database."""
