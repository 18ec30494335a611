"""Value logs as Parquet. Such a file is readable only when complete, so rows first go to a CSV journal beside it.

The journal FILE.parquet.csv becomes FILE.parquet when the log is closed. A kill or a power cut leaves the journal,
which is readable like any CSV log; the next log of the same name continues it.
"""

from __future__ import annotations

import os
from datetime import timedelta
from itertools import islice
from typing import TYPE_CHECKING, Any

from drivecomm.errors import FileFormatError, UsageError
from drivecomm.plant.value_log.csv_files import CsvLog, read_csv
from drivecomm.plant.value_log.rows import BEGINNING, COLUMNS, LogRow

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

ROWS_A_GROUP = 50_000


class ParquetLog:
    """Parquet file that is written when it is closed. Raises FileFormatError if the file already exists."""

    def __init__(self, path: Path) -> None:
        _pyarrow()
        if path.exists():
            raise FileFormatError(f"{path} exists already, and a Parquet file takes no more rows; give another name")
        self._path = path
        self._journal = CsvLog(journal_of(path))

    def write(self, row: LogRow) -> None:
        """Append a row to the journal."""
        self._journal.write(row)

    def close(self) -> None:
        """Convert the journal to the Parquet file, and remove the journal when the file is complete."""
        self._journal.close()
        journal, unfinished = journal_of(self._path), self._path.with_name(self._path.name + ".unfinished")
        try:
            _convert(journal, unfinished)
            unfinished.replace(self._path)
        except OSError as error:
            reason = os.strerror(error.errno) if error.errno else error
            raise FileFormatError(f"{self._path}: cannot be written: {reason}; the rows are in {journal}") from error
        finally:
            unfinished.unlink(missing_ok=True)
        journal.unlink()

    def abandon(self) -> None:
        """Keep the journal as it is, or remove it if it was made for this log and got no row."""
        self._journal.abandon()


def journal_of(path: Path) -> Path:
    """Return the path of the journal that holds the rows of a Parquet file until it is closed."""
    return path.with_name(path.name + ".csv")


def read_parquet(path: Path) -> Iterator[LogRow]:
    """Yield the rows of a file, group by group. Raises FileFormatError for a file that is not a log."""
    arrow, parquet = _pyarrow()
    try:
        file = parquet.ParquetFile(path)
    except (arrow.ArrowInvalid, OSError) as error:
        reason = os.strerror(error.errno) if isinstance(error, OSError) and error.errno else error
        raise FileFormatError(f"{path}: cannot be read as Parquet: {' '.join(str(reason).split())}") from error
    with file:
        if set(COLUMNS) - set(file.schema_arrow.names):
            raise FileFormatError(f"{path} is not a value log; it must have the columns {', '.join(COLUMNS)}")
        for batch in file.iter_batches(batch_size=ROWS_A_GROUP, columns=list(COLUMNS)):
            # Reading whole columns, with times as numbers, is several times faster than row by row.
            stamps = batch.column("time").cast(arrow.timestamp("ms", tz="UTC")).cast(arrow.int64()).to_pylist()
            others = [batch.column(name).to_pylist() for name in COLUMNS[1:]]
            for stamp, *texts in zip(stamps, *others, strict=True):
                yield LogRow(
                    time=BEGINNING + timedelta(milliseconds=stamp), **dict(zip(COLUMNS[1:], texts, strict=True))
                )


def _convert(journal: Path, target: Path) -> None:
    arrow, parquet = _pyarrow()
    word = arrow.dictionary(arrow.int32(), arrow.string())
    words = ("drive", "name", "address", "unit", "quality")
    schema = arrow.schema(
        [
            ("time", arrow.timestamp("ms", tz="UTC")),
            *((name, word if name in words else arrow.string()) for name in COLUMNS[1:]),
            ("number", arrow.float64()),
        ]
    )
    rows = read_csv(journal)
    with parquet.ParquetWriter(target, schema) as writer:
        while group := list(islice(rows, ROWS_A_GROUP)):
            columns: dict[str, list[Any]] = {name: [getattr(row, name) for row in group] for name in COLUMNS}
            columns["number"] = [row.number for row in group]
            writer.write_table(arrow.table(columns, schema=schema))


def _pyarrow() -> tuple[Any, Any]:
    """Return pyarrow and its Parquet module; both are optional, and slow to load."""
    try:
        import pyarrow as arrow  # noqa: ICN001 - the name used in this module
        from pyarrow import parquet
    except ImportError:
        raise UsageError("Parquet needs pyarrow, which is not installed; install drivecomm[log], or use .csv") from None
    return arrow, parquet
