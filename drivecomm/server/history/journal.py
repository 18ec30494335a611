"""The writer of a history: everything is queued and written by a separate thread, so that no caller waits."""

from __future__ import annotations

import logging
import sqlite3
import threading
import time
from collections import deque
from contextlib import suppress
from datetime import datetime
from typing import TYPE_CHECKING

from drivecomm.errors import FileFormatError, UsageError
from drivecomm.server.history.age import AgeLimit
from drivecomm.server.history.schema import code_of, is_damaged, move_aside
from drivecomm.server.history.store import CommandDone, FaultLogRead, Gap, HistoryFile, JournalEntry

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from drivecomm.protocol import Reading
    from drivecomm.server import Caller, CommandAnswer, CommandRequest, CurrentValue, Event

COMMITTED_EVERY_S = 0.5
ROWS_A_COMMIT = 5_000
MOST_WAITING = 100_000
"""Limit of values that are queued while the file cannot be written; the same limit applies to events."""

TRIED_AGAIN_S = 5.0
_TIDIED_EVERY_S = 60.0
_LEAST_MEGABYTES = 10
_LOGGER = logging.getLogger("drivecomm.history")


class HistoryWriter:
    """The writer of one history file. All methods may be called from any thread and never wait.

    Queued items are committed within half a second, and then survive any end of the process. While the file cannot be
    written, values are queued up to MOST_WAITING; beyond that the oldest are dropped, and the history records the gap.
    days, megabytes: limits of the stored history. tell: called with sentences about problems, in another thread; by
    default the logger drivecomm.history gets them.

    A damaged file is moved aside, and a new one is created. Raises FileFormatError for a file of another program, a
    file that another process writes, and a file that cannot be created; UsageError for invalid limits.
    """

    def __init__(
        self, file: Path, days: float = 30, megabytes: float = 1000, *, tell: Callable[[str], None] | None = None
    ) -> None:
        if days <= 0 or megabytes < _LEAST_MEGABYTES:
            raise UsageError(
                f"{file}: a history keeps more than 0 days and at least {_LEAST_MEGABYTES} megabytes, "
                f"not {days:g} days and {megabytes:g} megabytes"
            )
        self.file = file
        self.written = 0
        """Number of committed values."""
        self.missing = 0
        """Number of values that were dropped while the file could not be written."""
        self.last_row = 0
        """The row of the latest committed value, 0 before the first one."""
        self._days, self._megabytes = days, megabytes
        self._tell = tell or _LOGGER.warning
        self._guard = threading.Lock()
        self._values: deque[Sequence[CurrentValue]] = deque()
        self._waiting = 0
        self._others: deque[JournalEntry] = deque(maxlen=MOST_WAITING)
        self._dropped: Gap | None = None
        self._trouble = ""
        self._store: HistoryFile | None = None
        self._wake = threading.Event()
        self._closing = False
        self._lock = _locked(file)
        try:
            self._store = self._opened()
            self.last_row = self._store.last_row
        except sqlite3.Error as error:
            if code_of(error) in _NEVER:
                self._lock.close()
                raise FileFormatError(f"{self.file}: cannot be written as a history: {error}") from error
            self._failed(error)
        except BaseException:
            self._lock.close()
            raise
        self._note_the_time_without_a_server()
        self._thread = threading.Thread(target=self._write_on, name="history", daemon=True)
        self._thread.start()

    @property
    def waiting(self) -> int:
        """The number of queued values."""
        return self._waiting

    def add_values(self, values: Sequence[CurrentValue]) -> None:
        """Queue values in the order in which they came; the sequence must not change afterwards."""
        with self._guard:
            before = self._waiting
            self._values.append(values)
            self._waiting += len(values)
            self._drop_oldest()
            many = before < ROWS_A_COMMIT <= self._waiting
        if many:
            self._wake.set()

    def add_events(self, events: Sequence[Event]) -> None:
        """Queue events in the order in which they came."""
        with self._guard:
            self._others.extend(events)

    def add_command(
        self, caller: Caller, command: CommandRequest, answer: CommandAnswer, *, asked_s: float, done_s: float
    ) -> None:
        """Queue a command with its caller and its outcome. asked_s, done_s: in seconds since 1970."""
        with self._guard:
            self._others.append(CommandDone(caller, command, answer, asked_s, done_s))

    def add_fault_log(self, drive: str, entries: Sequence[Reading], *, time_s: float) -> None:
        """Queue the fault log of a drive as read at a time, the newest entry first."""
        with self._guard:
            self._others.append(FaultLogRead(drive, entries, time_s))

    def close(self, timeout_s: float = 5.0) -> None:
        """Write all queued items, and close the file; waits at most `timeout_s`, even if the disk hangs."""
        self._closing = True
        self._wake.set()
        self._thread.join(timeout_s)
        if self._thread.is_alive():
            self._tell(f"{self.file}: the disk does not answer; what was not yet written to the history is lost")

    def _drop_oldest(self) -> None:
        while self._waiting > MOST_WAITING:
            gone = self._values.popleft()
            self._waiting -= len(gone)
            self.missing += len(gone)
            if gone:
                # Values put back after a failure are older than those dropped meanwhile.
                times = [gone[0].time_s, gone[-1].time_s, *(self._dropped[:2] if self._dropped else ())]
                self._dropped = Gap(min(times), max(times), "")

    def _write_on(self) -> None:
        age_limit, tidied_s, retry_s = AgeLimit(self._days), time.monotonic(), 0.0
        while True:
            self._wake.wait(COMMITTED_EVERY_S)
            self._wake.clear()
            closing, now_s = self._closing, time.monotonic()
            before_s = age_limit.before_s(time.time(), now_s)
            if closing or now_s >= retry_s:
                try:
                    store = self._store = self._store or self._opened()
                    self._write(store)
                    self.last_row = store.last_row
                    if not closing:
                        store.sort()
                        if now_s - tidied_s >= _TIDIED_EVERY_S and not store.drop_oldest(
                            before_s=before_s, megabytes=self._megabytes
                        ):
                            tidied_s = now_s
                except (sqlite3.Error, FileFormatError, OSError) as error:
                    retry_s = 0.0 if self._failed(error) else time.monotonic() + TRIED_AGAIN_S
            if closing:
                break
        if self._waiting or self._others:
            self._tell(f"{self.file}: {self._trouble}; {self._waiting} values were not written to the history")
        if self._store is not None:
            with suppress(sqlite3.Error):
                self._store.close()
        self._lock.close()

    def _write(self, store: HistoryFile) -> None:
        """Write all queued items, in batches. Raises sqlite3.Error; unwritten items then stay queued."""
        with self._guard:
            values = [each for piece in self._values for each in piece]
            self._values.clear()
            self._waiting = 0
            others = list(self._others)
            self._others.clear()
            dropped, self._dropped = self._dropped, None
        if not values and not others:
            return
        if dropped:
            others.append(dropped._replace(text=f"values were lost, because of the history's file: {self._trouble}"))
        done = 0
        try:
            while others or done < len(values):
                batch = values[done : done + ROWS_A_COMMIT]
                store.add(batch, others)
                done, others, dropped = done + len(batch), [], None
        except BaseException:
            self._put_back(values[done:], others[:-1] if dropped else others, dropped)
            raise
        finally:
            self.written += done
        if self._trouble:
            self._tell(f"{self.file}: writing the history has resumed; {self.missing} values are missing in all")
            self._trouble = ""

    def _put_back(self, values: Sequence[CurrentValue], others: Sequence[JournalEntry], dropped: Gap | None) -> None:
        with self._guard:
            if dropped:
                later = self._dropped
                self._dropped = dropped._replace(to_s=later.to_s) if later else dropped
            # Put back in batches, so that later drops also remove whole batches.
            pieces = [values[first : first + ROWS_A_COMMIT] for first in range(0, len(values), ROWS_A_COMMIT)]
            self._values.extendleft(reversed(pieces))
            self._waiting += len(values)
            self._others.extendleft(reversed(others))
            self._drop_oldest()

    def _opened(self) -> HistoryFile:
        """Open the file, at the start and after each problem; move a damaged file aside."""
        try:
            return HistoryFile(self.file)
        except sqlite3.Error as error:
            if not is_damaged(error):
                raise
            self._move_aside()
            return HistoryFile(self.file)

    def _note_the_time_without_a_server(self) -> None:
        latest_s, now_s = self._store.latest_s() if self._store else None, time.time()
        if latest_s is not None and latest_s < now_s:
            self._others.append(Gap(latest_s, now_s, "no values were recorded: no server was running"))

    def _failed(self, error: Exception) -> bool:
        """Close the file after an error; return whether a new file can be created immediately."""
        if self._store is not None:
            # Its cached state may include rows that were not committed.
            with suppress(sqlite3.Error):
                self._store.close()
            self._store = None
        if isinstance(error, sqlite3.Error) and is_damaged(error):
            with suppress(OSError):
                self._move_aside()
                return True
        if not self._trouble:
            self._tell(
                f"{self.file}: {error}; the history is not written from {datetime.now().astimezone():%H:%M:%S} on, "
                "and retried every few seconds; everything else continues"
            )
        self._trouble = str(error)
        return False

    def _move_aside(self) -> None:
        aside = move_aside(self.file, f"damaged-{datetime.now().astimezone():%Y%m%dT%H%M%S}")
        self._tell(f"{self.file}: is damaged; it is kept as {aside.name}, and a new history begins")


_NEVER = (sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_READONLY, sqlite3.SQLITE_PERM, sqlite3.SQLITE_AUTH)


def _locked(file: Path) -> sqlite3.Connection:
    """Return a lock on the history, held until it is closed or the process ends."""
    # A lock of SQLite on a separate file: it works on every system, and does not affect readers of the history.
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        lock = sqlite3.connect(
            file.with_name(file.name + ".lock"), timeout=0, isolation_level=None, check_same_thread=False
        )
    except (OSError, sqlite3.Error) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise FileFormatError(f"{file}: cannot be written as a history: {reason}") from error
    try:
        # Nothing is written to it, so a full disk does not matter.
        lock.execute("PRAGMA journal_mode = MEMORY")
        lock.execute("BEGIN EXCLUSIVE")
    except sqlite3.Error as error:
        lock.close()
        if code_of(error) == sqlite3.SQLITE_BUSY:
            raise FileFormatError(
                f"{file}: another server writes this history; stop it, or give this one another file"
            ) from error
        raise FileFormatError(f"{file}: cannot be written as a history: {error}") from error
    return lock
