"""State of an edge node that survives a crash: the number of its last connection and its delivery position."""

from __future__ import annotations

import json
import logging
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from drivecomm.errors import DriveCommError
from drivecomm.tomlfile import write_atomically

if TYPE_CHECKING:
    from pathlib import Path

_log = logging.getLogger("drivecomm.server")

_NUMBERS = 256
"""Connection numbers count from 0 to 255 and then start again."""


class EdgeNodeState:
    """File of one edge node in the server's state folder.

    bd_seq: number of the present or last connection, None before the first. row: row of the history up to which
    everything has certainly been delivered, None before the first delivery. waiting: by drive, the range of rows (after
    the first, up to the second) that could not be delivered because the drive was silent and therefore not born.
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
        """Return the number of the next connection, which has already been saved.

        A broker may publish the will of an earlier connection late. A number of its own ensures that such a will ends
        only that connection, even after a crash of this process.
        """
        self.bd_seq = 0 if self.bd_seq is None else (self.bd_seq + 1) % _NUMBERS
        self._changed = True
        self.save()
        return self.bd_seq

    def not_connected(self) -> None:
        """Revert to the previous number, because nothing was sent with this one."""
        if self.bd_seq is not None:
            self.bd_seq = (self.bd_seq or _NUMBERS) - 1

    def passed_on(self, row: int) -> None:
        """Set the position up to which the history was delivered; takes effect in the file at the next `save`."""
        self._changed |= row != self.row
        self.row = row

    def passed_on_later(self, drive: str) -> None:
        """Remove the waiting rows of a drive after delivery; takes effect in the file at the next `save`."""
        self._changed |= self.waiting.pop(drive, None) is not None

    def waits(self, drive: str, after: int, until: int) -> None:
        """Add a range of waiting rows for a drive; takes effect in the file at the next `save`."""
        first, last = self.waiting.get(drive, (after, until))
        self.waiting[drive] = min(first, after), max(last, until)
        self._changed = True

    def save(self) -> None:
        """Write changes to the file; may run in another thread. A failure is logged and does not end the session."""
        if not self._changed:
            return
        self._changed = False
        content = {"bd_seq": self.bd_seq, "row": self.row, "waiting": self.waiting}
        try:
            self._file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            write_atomically(self._file, json.dumps(content), mode=0o600)
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
