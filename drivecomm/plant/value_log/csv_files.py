"""Value logs as CSV: each row is written to the file immediately, so that an abrupt end loses at most one row."""

from __future__ import annotations

import csv
import io
from typing import TYPE_CHECKING

from drivecomm.capture import GrowingFile
from drivecomm.errors import FileFormatError
from drivecomm.plant.value_log.rows import COLUMNS, LogRow, row_from

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_HEAD = (",".join(COLUMNS) + "\n").encode()
_LONGEST_ROW = 1 << 16
"""Limit of the length of a row in bytes; a file without a row end within this distance from its end is not a log."""


class CsvLog:
    """CSV file to which rows are appended; an existing file of this form is continued. Raises FileFormatError."""

    def __init__(self, path: Path) -> None:
        self._path = path
        try:
            keep = _whole_rows(path)
            self._made = not path.exists()
            self._file = GrowingFile(path, keep)
        except OSError as error:
            raise FileFormatError(f"{path}: cannot be written as a log: {error.strerror or error}") from error
        try:
            if not keep:
                self._file.add(_HEAD)
        except OSError as error:
            self.abandon()
            raise FileFormatError(f"{path}: cannot be written as a log: {error.strerror or error}") from error

    def write(self, row: LogRow) -> None:
        """Append a row and pass it to the operating system. On OSError, the file has no part of the row."""
        line = io.StringIO()
        csv.DictWriter(line, COLUMNS, lineterminator="\n").writerow(row.texts())
        self._file.add(line.getvalue().encode())

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def abandon(self) -> None:
        """Close the file, and remove it if it was made for this log and got no row."""
        self._file.close()
        if self._made and self._file.size <= len(_HEAD):
            self._path.unlink(missing_ok=True)


def _whole_rows(path: Path) -> int:
    """Return the length of the complete rows of a file in bytes. Raises FileFormatError for another kind of file."""
    if not path.exists() or not path.stat().st_size:
        return 0
    with path.open("rb") as file:
        head = file.read(len(_HEAD))
        if head != _HEAD:
            if _HEAD.startswith(head):
                return 0
            raise FileFormatError(f"{path} exists already and is not a value log; give another name")
        size = file.seek(0, 2)
        file.seek(max(0, size - _LONGEST_ROW))
        return size - len(file.read().rpartition(b"\n")[2])


def read_csv(path: Path) -> Iterator[LogRow]:
    """Yield the rows of a file; a cut-off last row is left out. Raises FileFormatError with the line."""
    with path.open(encoding="utf-8", newline="") as file:
        lines = csv.DictReader(_whole_lines(file))
        if lines.fieldnames is None or set(COLUMNS) - set(lines.fieldnames):
            raise FileFormatError(f"{path} is not a value log; its first line must be {','.join(COLUMNS)}")
        try:
            for line in lines:
                yield _row(line, path, lines.line_num)
        except csv.Error as error:
            raise FileFormatError(f"{path}, line {lines.line_num}: {error}") from error


def _whole_lines(file: Iterator[str]) -> Iterator[str]:
    # A line without an end was being written when the power failed.
    return (line for line in file if line.endswith("\n"))


def _row(content: dict[str, str], path: Path, line: int) -> LogRow:
    try:
        return row_from(content)
    except (ValueError, TypeError, KeyError) as error:
        raise FileFormatError(f"{path}, line {line}: not a row of a value log: {error}") from error
