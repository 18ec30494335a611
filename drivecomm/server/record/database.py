"""What a record needs of its database; times are milliseconds since 1970 here, whatever the database makes of them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from collections.abc import Sequence
    from contextlib import AbstractContextManager

TO_THE_END_MS = 253_402_300_799_000
"""The last millisecond that all databases and Python can hold: the end of the year 9999."""


class Database(Protocol):
    """An open database with the tables of a record, used by one thread.

    Methods raise LinkDownError when it cannot be reached any more, after which it is closed and opened again, and
    ValueError for content that it cannot hold.
    """

    place: str
    """How messages name it, without user and password."""

    def all(self, question: str, values: Sequence[object] = ()) -> list[tuple[Any, ...]]:
        """Carry out a statement, with %s for each value, and return its rows."""

    def add(self, table: str, rows: Sequence[tuple[object, ...]]) -> int:
        """Add rows whose key is not there yet; return how many those were. Numbers are given as texts."""

    def transaction(self) -> AbstractContextManager[object]:
        """Do all of the block, or nothing; what is done outlives a power cut."""

    def moment(self) -> str:
        """Return SQL for a time that is given as a value."""

    def milliseconds(self, column: str) -> str:
        """Return SQL that reads a time."""

    def close(self) -> None:
        """Close it."""
