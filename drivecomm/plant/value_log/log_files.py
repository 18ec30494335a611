"""Writing and reading of value logs, in the format given by the file name."""

from __future__ import annotations

import logging
from dataclasses import replace
from datetime import timedelta
from typing import TYPE_CHECKING, Self

from drivecomm.capture import WriteGaps
from drivecomm.errors import FileFormatError, UsageError
from drivecomm.plant.value_log.csv_files import CsvLog, read_csv
from drivecomm.plant.value_log.parquet_files import ParquetLog, journal_of, read_parquet
from drivecomm.plant.value_log.rows import LogRow, row_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from datetime import datetime
    from pathlib import Path

    from drivecomm.line import PollResult

_LOGGER = logging.getLogger("drivecomm.value_log")
# Time resolution of a log.
_TICK = timedelta(milliseconds=1)
_SAME_MOMENT = timedelta(seconds=1)


class ValueLog:
    """Log of poll results; a context manager that closes it. Use `open_log` to get one.

    A full disk does not end the log: rows are missing until there is room again, and `tell` is called at both times.
    Time, drive and name of a row are unique in a log: a second row within the same millisecond gets the next
    millisecond.
    """

    def __init__(self, path: Path, rows: CsvLog | ParquetLog, tell: Callable[[str], None] | None = None) -> None:
        self.path = path
        self.written = 0
        self._rows = rows
        self._gaps = WriteGaps(str(path), kept="values", done="logged", goes_on="polling", tell=tell or _LOGGER.warning)
        self._latest: dict[tuple[str, str], datetime] = {}

    @property
    def missing(self) -> int:
        """Number of rows that could not be written for lack of disk space."""
        return self._gaps.missing

    @property
    def summary(self) -> str:
        """Sentence on the missing rows; empty if no row is missing."""
        return self._gaps.summary

    def write(self, result: PollResult) -> None:
        """Write the result of one poll, including a failed one."""
        row = self._at_a_time_of_its_own(row_of(result))
        self.written += self._gaps.write(lambda: self._rows.write(row), result.time_s)

    def _at_a_time_of_its_own(self, row: LogRow) -> LogRow:
        key = (row.drive, row.name)
        time, latest = row.time.replace(microsecond=row.time.microsecond // 1000 * 1000), self._latest.get(key)
        if latest is not None and timedelta(0) <= latest - time < _SAME_MOMENT:
            time = latest + _TICK
        self._latest[key] = time
        return replace(row, time=time)

    def close(self) -> None:
        """Complete and close the file. Raises FileFormatError if that fails."""
        self._rows.close()

    def abandon(self) -> None:
        """Close the log without completing it; remove its file if it was made for this log and got no row."""
        self._rows.abandon()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: BaseException | None, traceback: object) -> None:
        if error is not None and not self.written:
            self.abandon()
        else:
            self.close()


def open_log(path: Path, *, tell: Callable[[str], None] | None = None) -> ValueLog:
    """Open a log: .csv, which is appended to if it exists, or .parquet, which must not exist.

    tell: called with a sentence when rows cannot be written for lack of disk space, and when they can be written again;
    by default the logger drivecomm.value_log. Raises UsageError for another ending and if pyarrow is missing,
    FileFormatError for a file that cannot be written.
    """
    if path.suffix == ".csv":
        return ValueLog(path, CsvLog(path), tell)
    if path.suffix == ".parquet":
        return ValueLog(path, ParquetLog(path), tell)
    raise UsageError(f"{path}: a log is .csv or .parquet; give it one of these endings")


def read_rows(path: Path) -> Iterator[LogRow]:
    """Yield the rows of a log in the order in which they were written.

    For a Parquet log that was never completed, yields the rows of its journal. Raises FileFormatError, UsageError.
    """
    if path.suffix == ".parquet":
        # A killed process leaves only the journal.
        killed = not path.exists() and journal_of(path).exists()
        rows = read_csv(journal_of(path)) if killed else read_parquet(path)
    elif path.suffix == ".csv":
        rows = read_csv(path)
    else:
        raise UsageError(f"{path}: a log is .csv or .parquet; name one of these")
    try:
        yield from rows
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else error
        raise FileFormatError(f"{path}: cannot be read as a log: {reason}") from error
