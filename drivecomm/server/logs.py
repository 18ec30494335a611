"""The log of a server: on stderr in the form that the journal of systemd reads, or in a file that rotates.

All modules log with the standard library. A separate thread writes the messages, so that a blocked terminal, pipe or
disk delays nothing else. Messages that do not fit into the queue are counted.
"""

from __future__ import annotations

import logging
import os
import queue
import sys
import threading
import time
from contextlib import contextmanager, suppress
from copy import copy
from dataclasses import dataclass
from datetime import datetime
from itertools import pairwise
from typing import TYPE_CHECKING, Protocol

from drivecomm.capture import GrowingFile, WriteGaps
from drivecomm.errors import UsageError, printable

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

LOG_LEVELS = ("debug", "info", "warning", "error")
_WAITING = 10_000
"""Length of the queue of messages."""

_PATIENCE_S = 2.0
"""Time for which the end of the server waits for the last messages."""

_REPEATED_S = 60.0
_DISTINCT = 1000
"""Number of different messages whose repetitions are counted."""

_LARGEST = 10_000_000
_OLDER_FILES = 5


class Destination(Protocol):
    """A destination of log messages."""

    def write(self, record: logging.LogRecord) -> None:
        """Write a message."""

    def close(self) -> None:
        """Close the destination."""


@contextmanager
def logging_to(file: Path | None, level: str) -> Iterator[None]:
    """Write the log to a file, or to stderr without one. level: one of `LOG_LEVELS`.

    Messages of libraries are logged from warnings on. Raises UsageError for a file that cannot be opened.
    """
    try:
        destination: Destination = Stderr() if file is None else RotatingFile(file)
    except OSError as error:
        raise UsageError(f"{file}: cannot be written as a log: {error.strerror or error}; name another file") from error
    handler = WaitingHandler(destination)
    root, own = logging.getLogger(), logging.getLogger("drivecomm")
    before = root.level, own.level
    root.setLevel(max(logging.WARNING, logging.getLevelNamesMapping()[level.upper()]))
    own.setLevel(level.upper())
    root.addHandler(handler)
    try:
        yield
    finally:
        root.removeHandler(handler)
        root.setLevel(before[0])
        own.setLevel(before[1])
        handler.close()


class WaitingHandler(logging.Handler):
    """A log handler that queues messages for a writing thread, and never waits for it."""

    def __init__(self, destination: Destination) -> None:
        super().__init__()
        self._queue: queue.Queue[logging.LogRecord | None] = queue.Queue(_WAITING)
        self._lost = 0
        self._thread = threading.Thread(target=self._write_all, args=(destination,), name="log", daemon=True)
        self._thread.start()

    def emit(self, record: logging.LogRecord) -> None:
        """Queue a message; count it as lost if the queue is full."""
        plain = copy(record)
        # Formatted now, because the arguments may change before the message is written.
        plain.msg, plain.args = printable(" ".join(record.getMessage().splitlines())), None
        if record.exc_info:
            plain.exc_text = logging.Formatter().formatException(record.exc_info)
            plain.exc_info = None
        try:
            self._queue.put_nowait(plain)
        except queue.Full:
            self._lost += 1

    def close(self) -> None:
        """Write the queued messages, as far as possible within a few seconds."""
        with suppress(queue.Full):
            self._queue.put(None, timeout=_PATIENCE_S)
        self._thread.join(_PATIENCE_S)
        super().close()

    def _write_all(self, destination: Destination) -> None:
        repetitions = Repetitions()
        while True:
            record: logging.LogRecord | None
            try:
                record = self._queue.get(timeout=1.0)
            except queue.Empty:
                told = repetitions.due(time.monotonic())
            else:
                if record is None:
                    break
                told = repetitions.take(record, time.monotonic())
            if self._lost and self._queue.qsize() < _WAITING // 2:
                lost, self._lost = self._lost, 0
                told.append(
                    _message(
                        logging.WARNING,
                        f"{lost} messages were lost, because they arrived faster than they were written",
                    )
                )
            for each in told:
                destination.write(each)
        for each in repetitions.rest(time.monotonic()):
            destination.write(each)
        destination.close()


@dataclass(slots=True)
class _Repeated:
    record: logging.LogRecord
    since: float
    more: int = 0


class Repetitions:
    """A filter that passes the first of equal messages and counts the others for a minute.

    Times are monotonic seconds.
    """

    def __init__(self) -> None:
        self._known: dict[tuple[str, int, str], _Repeated] = {}

    def take(self, record: logging.LogRecord, now: float) -> list[logging.LogRecord]:
        """Return the messages to write after this message has arrived."""
        told = self.due(now)
        key = record.name, record.levelno, record.msg
        known = self._known.get(key)
        if known is not None:
            known.more += 1
            return told
        if len(self._known) >= _DISTINCT:
            told.extend(self._counted(self._known.pop(next(iter(self._known))), now))
        self._known[key] = _Repeated(record, now)
        return [*told, record]

    def due(self, now: float) -> list[logging.LogRecord]:
        """Return the counts that are a minute old, and count messages that were repeated for another minute."""
        told = []
        for key, known in [(key, known) for key, known in self._known.items() if now - known.since >= _REPEATED_S]:
            del self._known[key]
            if known.more:
                told.extend(self._counted(known, now))
                self._known[key] = _Repeated(known.record, now)
        return told

    def rest(self, now: float) -> list[logging.LogRecord]:
        """Return all remaining counts."""
        return [each for known in self._known.values() for each in self._counted(known, now)]

    @staticmethod
    def _counted(known: _Repeated, now: float) -> list[logging.LogRecord]:
        if not known.more:
            return []
        times = f"{known.more} more time{'' if known.more == 1 else 's'}"
        text = f"{known.record.msg} ({times} in the last {max(1, round(now - known.since))} s)"
        counted = copy(known.record)
        counted.msg, counted.exc_text, counted.created = text, None, time.time()
        return [counted]


class Stderr:
    """Messages on stderr; with priorities and without the time if the journal of systemd reads it."""

    def __init__(self) -> None:
        self._form: Callable[[logging.LogRecord], str] = for_journal if _is_journal(2) else for_people

    def write(self, record: logging.LogRecord) -> None:
        """Write a message."""
        with suppress(OSError, ValueError):
            sys.stderr.write(self._form(record))
            sys.stderr.flush()

    def close(self) -> None:
        """Leave stderr as it is."""


class RotatingFile:
    """Messages in a file. A large file becomes FILE.1, and older ones move up by one; five are retained.

    While the file cannot be written, messages are lost. The loss is reported on stderr immediately, and in the file
    when writing works again. largest: in bytes. now: the time of day. Raises OSError for a file that cannot be opened.
    """

    def __init__(self, path: Path, *, largest: int = _LARGEST, now: Callable[[], float] = time.time) -> None:
        self._path, self._largest, self._now = path, largest, now
        self._told: list[str] = []
        self._gaps = WriteGaps(str(path), kept="messages", done="logged", goes_on="the server", tell=self._tell)
        self._file: GrowingFile | None = self._opened()

    def write(self, record: logging.LogRecord) -> None:
        """Write a message, or count it as lost."""
        line = for_people(record).encode(errors="backslashreplace")
        if self._gaps.write(lambda: self._add(line), self._now()) and self._told:
            again = for_people(_message(logging.WARNING, self._told[-1])).encode()
            self._told.clear()
            with suppress(OSError):
                self._add(again)

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()

    def _tell(self, text: str) -> None:
        self._told.append(text)
        Stderr().write(_message(logging.WARNING, text))

    def _opened(self) -> GrowingFile:
        self._path.parent.mkdir(parents=True, exist_ok=True)
        if not self._path.exists():
            # Commands and their callers are only for the owner of the server to read.
            self._path.touch(mode=0o600)
        size = self._path.stat().st_size
        return GrowingFile(self._path, keep=size)

    def _add(self, line: bytes) -> None:
        if self._file is not None and self._file.size and self._file.size + len(line) > self._largest:
            self._file.close()
            self._file = None
            self._rotate()
        if self._file is None:
            self._file = self._opened()
        self._file.add(line)

    def _rotate(self) -> None:
        names = [self._path, *(self._path.with_name(f"{self._path.name}.{n}") for n in range(1, _OLDER_FILES + 1))]
        for newer, older in reversed(list(pairwise(names))):
            if newer.exists():
                newer.replace(older)


def for_people(record: logging.LogRecord) -> str:
    """Return a message for people to read: a line with time and level, then the lines of a traceback, indented."""
    at = datetime.fromtimestamp(record.created).astimezone().isoformat(sep=" ", timespec="milliseconds")
    return "".join(f"{line}\n" for line in _lines(record, f"{at} {record.levelname.lower():<7} "))


def for_journal(record: logging.LogRecord) -> str:
    """Return a message in the form of sd-daemon(3), with its priority before each line."""
    priority = {logging.DEBUG: 7, logging.INFO: 6, logging.WARNING: 4, logging.ERROR: 3}.get(record.levelno, 2)
    return "".join(f"<{priority}>{line}\n" for line in _lines(record, ""))


def _lines(record: logging.LogRecord, head: str) -> list[str]:
    source = "" if record.name.startswith("drivecomm") else f"{record.name}: "
    return [f"{head}{source}{record.msg}", *(f"    {printable(line)}" for line in (record.exc_text or "").splitlines())]


def _message(level: int, text: str) -> logging.LogRecord:
    return logging.LogRecord("drivecomm", level, "", 0, text, None, None)


def _is_journal(descriptor: int) -> bool:
    stream = os.environ.get("JOURNAL_STREAM", "")
    try:
        found = os.fstat(descriptor)
    except OSError:
        return False
    return stream == f"{found.st_dev}:{found.st_ino}"
