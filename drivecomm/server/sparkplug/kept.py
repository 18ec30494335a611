"""What an edge node must still know after it was killed: the number of its last connection, and what was passed on."""

from __future__ import annotations

import json
import logging
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from drivecomm.errors import DriveCommError
from drivecomm.tomlfile import write_whole

if TYPE_CHECKING:
    from pathlib import Path

_log = logging.getLogger("drivecomm.server")

_NUMBERS = 256
"""The numbers of connections go from 0 to 255, and begin again."""


class KeptSession:
    """The file of one edge node in the server's state folder.

    bd_seq: the number of the connection that is, or was last, None before the first one. row: up to which row of the
    history everything has surely been passed on, None before anything was. waiting: from after which row to which one
    it was not for some drives, because hosts do not know a drive that is silent; by their names.
    """

    def __init__(self, file: Path) -> None:
        self._file = file
        self._failing = self._changed = False
        known = _read(file)
        self.bd_seq: int | None = _whole(known.get("bd_seq"), _NUMBERS - 1)
        self.row: int | None = _whole(known.get("row"), 2**63)
        waiting = known.get("waiting")
        self.waiting: dict[str, tuple[int, int]] = {
            drive: (rows[0], rows[1])
            for drive, rows in (waiting.items() if isinstance(waiting, dict) else ())
            if isinstance(rows, list) and len(rows) == 2 and all(_whole(each, 2**63) is not None for each in rows)
        }

    def next_connection(self) -> int:
        """Return the number of the next connection; it is in the file when this returns.

        A broker may send the will of an earlier connection late. With a number of its own it ends that one alone, also
        when this process was killed meanwhile.
        """
        self.bd_seq = 0 if self.bd_seq is None else (self.bd_seq + 1) % _NUMBERS
        self._changed = True
        self.save()
        return self.bd_seq

    def not_connected(self) -> None:
        """Take the number back: nothing was sent with it."""
        if self.bd_seq is not None:
            self.bd_seq = (self.bd_seq or _NUMBERS) - 1

    def passed_on(self, row: int) -> None:
        """Take note that the history was passed on up to this row; save it then."""
        self._changed |= row != self.row
        self.row = row

    def passed_on_later(self, drive: str) -> None:
        """Take note that what had waited for a drive was passed on; save it then."""
        self._changed |= self.waiting.pop(drive, None) is not None

    def waits(self, drive: str, after: int, until: int) -> None:
        """Take note that what came for a drive after a row, until another one, has to wait; save it then."""
        first, last = self.waiting.get(drive, (after, until))
        self.waiting[drive] = min(first, after), max(last, until)
        self._changed = True

    def save(self) -> None:
        """Write what has changed; may be called in another thread. That it fails is told, and costs no session."""
        if not self._changed:
            return
        self._changed = False
        content = {"bd_seq": self.bd_seq, "row": self.row, "waiting": self.waiting}
        try:
            self._file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            write_whole(self._file, json.dumps(content), mode=0o600)
        except (DriveCommError, OSError) as error:
            if not self._failing:
                _log.warning(
                    "%s; after a restart, a late will of an earlier connection may end a session of the same number",
                    error,
                )
            self._failing = True
        else:
            self._failing = False


def _read(file: Path) -> dict[str, Any]:
    with suppress(OSError, ValueError, RecursionError):
        known = json.loads(file.read_bytes())
        if isinstance(known, dict):
            return known
    return {}


def _whole(value: Any, most: int) -> int | None:
    return value if isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= most else None
