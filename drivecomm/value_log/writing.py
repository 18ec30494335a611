"""Opening a log for writing, in the form that its name says."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, Self

from drivecomm.errors import UsageError
from drivecomm.value_log.csv_files import CsvLog
from drivecomm.value_log.rows import LogRow, row_of

if TYPE_CHECKING:
    from pathlib import Path
    from types import TracebackType

    from drivecomm.polling import PollResult


class _Rows(Protocol):
    def write(self, row: LogRow) -> None: ...

    def close(self) -> None: ...


class ValueLog:
    """A log that poll results are written to; a context manager that closes it. Use `open_log` to get one."""

    def __init__(self, path: Path, rows: _Rows) -> None:
        self.path = path
        self.written = 0
        self._rows = rows

    def write(self, result: PollResult) -> None:
        """Write what came of asking once, also that nothing came."""
        self._rows.write(row_of(result))
        self.written += 1

    def close(self) -> None:
        """Finish the file."""
        self._rows.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()


def open_log(path: Path) -> ValueLog:
    """Open a log: .csv, to which more is added if it is there, or .parquet, which must not be there.

    Raises UsageError for another ending and where pyarrow is missing, FileFormatError for a file that cannot be.
    """
    if path.suffix == ".csv":
        return ValueLog(path, CsvLog(path))
    if path.suffix == ".parquet":
        # Most logs are CSV.
        from drivecomm.value_log.parquet_files import ParquetLog  # noqa: PLC0415

        return ValueLog(path, ParquetLog(path))
    raise UsageError(f"{path}: a log is .csv or .parquet; give it one of these endings")
