"""Reading logs back, whatever their form."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.errors import FileFormatError, UsageError
from drivecomm.plant.value_log.csv_files import read_csv

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from drivecomm.plant.value_log.rows import LogRow


def read_rows(path: Path) -> Iterator[LogRow]:
    """Yield the rows of a log in the order in which they were written.

    Of a Parquet log that was never finished, those of its journal. Raises FileFormatError, UsageError.
    """
    if path.suffix == ".parquet":
        from drivecomm.plant.value_log.parquet_files import journal_of, read_parquet  # noqa: PLC0415 - most logs are CSV

        # What a kill leaves is the journal alone.
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
