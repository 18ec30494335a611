"""Logs of other programs, read as captures: bytes with direction and time, and remarks on unreadable lines."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from drivecomm.capture.pieces import Piece, Provenance
from drivecomm.capture.printed_line import PrintedLine, printed_lines
from drivecomm.errors import FileFormatError
from drivecomm.tomlfile import no_such_file

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path
    from typing import BinaryIO

APART_S = 0.1
"""Seconds between the pieces of a log without times."""

PRINTED_LOG = "a program that printed a log"
"""Tool of such a capture. Its directions come from words in the log, so telegrams identify the master again."""

_HALF_A_DAY_S, _DAY_S = 43200.0, 86400.0
_LARGEST = 64 * 1024 * 1024
_MARKS = {b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16"}


@dataclass(frozen=True, slots=True, kw_only=True)
class LogPiece:
    """Bytes in a log. line: number of the line in which they begin, from 1."""

    line: int
    piece: Piece


def read_log(path: Path) -> PrintedLogReader:
    """Read a log of another program. Raises FileFormatError if it is missing or contains no bytes."""
    try:
        with path.open("rb") as file:
            return PrintedLogReader(path, file)
    except FileNotFoundError:
        raise FileFormatError(no_such_file(path)) from None
    except OSError as error:
        raise FileFormatError(f"{path}: cannot read the log ({error.strerror or error})") from error


class PrintedLogReader:
    """Reader of a printed log. log: its bytes with line numbers. remarks: unreadable lines and the reasons.

    Raises FileFormatError if it contains no bytes.
    """

    def __init__(self, path: Path, file: BinaryIO) -> None:
        data = file.read(_LARGEST + 1)
        if len(data) > _LARGEST:
            raise FileFormatError(f"{path}: a log of more than 64 MiB is not read; cut it into parts")
        text = data.decode(_MARKS.get(data[:2], "utf-8-sig"), errors="replace")
        read = [
            (number, each) for number, line in enumerate(text.splitlines(), start=1) for each in printed_lines(line)
        ]
        self.remarks: list[str] = []
        self.log = tuple(self._pieces(path, _joined(read)))
        if not self.log:
            raise FileFormatError(
                f"{path}: neither a capture nor a log in which a line holds bytes that were sent or received"
            )
        self.provenance = Provenance(tool=PRINTED_LOG)

    def pieces(self) -> Iterator[Piece]:
        """Yield the pieces in order."""
        return (each.piece for each in self.log)

    def _pieces(self, path: Path, lines: list[tuple[int, PrintedLine]]) -> Iterator[LogPiece]:
        marked = any(line.mark and line.data for _, line in lines)
        timed = any(line.time_s is not None and line.data for _, line in lines)
        if not timed:
            self.remarks.append(f"{path}: the log has no times; its pieces are put {APART_S:g} s apart")
        began: float | None = None
        now_s, days_s = -APART_S, 0.0
        before: PrintedLine | None = None
        for number, line in lines:
            reason = line.reason
            if line.data and marked and not line.mark:
                reason = "the line does not say who sent these bytes, unlike other lines of this log"
            elif line.data and before is not None and _is_repeated(line, before, timed=timed):
                reason = "the same line again, without its time"
            if reason:
                self.remarks.append(f"{path}: line {number} is not read: {reason}")
            if reason or not line.data:
                continue
            if line.time_s is not None:
                began = line.time_s if began is None else began
                time_s = line.time_s - began + days_s
                if time_s < now_s - _HALF_A_DAY_S:
                    # The log has passed midnight.
                    days_s, time_s = days_s + _DAY_S, time_s + _DAY_S
                now_s = max(now_s, time_s, 0.0)
            else:
                now_s = max(now_s + (APART_S if not timed else 0.001), 0.0)
            before = line
            yield LogPiece(line=number, piece=Piece(time_s=now_s, data=line.data, source=line.source))


def _is_repeated(line: PrintedLine, before: PrintedLine, *, timed: bool) -> bool:
    """Whether a second handler of the same logger has repeated a line, without the time."""
    same = line.data == before.data and line.mark == before.mark
    return timed and same and line.time_s is None and before.time_s is not None


def _joined(lines: list[tuple[int, PrintedLine]]) -> list[tuple[int, PrintedLine]]:
    """Join bytes that were printed over several lines, and give dumps the direction from the line above them."""
    joined: list[tuple[int, PrintedLine]] = []
    heading = PrintedLine()
    latest = -1
    for number, line in lines:
        if line.style == "dump" and not line.mark and heading.mark:
            line = replace(line, mark=heading.mark, time_s=heading.time_s)  # noqa: PLW2901
        elif not line.data:
            heading = line if line.mark else heading
        before = joined[-1][1] if joined else None
        follows = (
            before is not None
            and latest == number - 1
            and line.style != ""
            and (before.style, before.mark) == (line.style, line.mark)
            and not line.begins
            and (line.style != "brackets" or line.mark == "received")
        )
        if before is not None and follows:
            joined[-1] = (joined[-1][0], replace(before, data=before.data + line.data))
        else:
            joined.append((number, line))
        latest = number
    return joined
