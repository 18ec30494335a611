"""Reading logs back, whatever their form."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.errors import FileFormatError, UsageError
from drivecomm.value_log.csv_files import read_csv

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from drivecomm.value_log.rows import LogRow


def read_rows(path: Path) -> Iterator[LogRow]:
    """Yield the rows of a log in the order in which they were written. Raises FileFormatError, UsageError."""
    if path.suffix == ".parquet":
        from drivecomm.value_log.parquet_files import read_parquet  # noqa: PLC0415 - most logs are CSV

        rows = read_parquet(path)
    elif path.suffix == ".csv":
        rows = read_csv(path)
    else:
        raise UsageError(f"{path}: a log is .csv or .parquet; name one of these")
    try:
        yield from rows
    except (OSError, UnicodeDecodeError) as error:
        raise FileFormatError(f"{path}: cannot be read as a log: {error}") from error
