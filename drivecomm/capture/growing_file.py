"""Append-only files that contain whole entries only, even if the disk fills up while other work continues."""

from __future__ import annotations

import errno
from contextlib import suppress
from datetime import datetime
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

TRIED_AGAIN_S = 5.0
"""Seconds to wait after a failed write before the next attempt."""

_REASONS = {
    errno.ENOSPC: "no space left on the device",
    errno.EDQUOT: "the disk quota is used up",
    errno.EFBIG: "the file may not grow any further",
    errno.EIO: "the device cannot be written",
}


class GrowingFile:
    """File for appending whole pieces; one that cannot be written completely is removed again.

    keep: number of existing bytes to keep. Unbuffered, so that added pieces are with the operating system. Raises
    OSError, as do its methods.
    """

    def __init__(self, path: Path, keep: int = 0) -> None:
        self._size = keep
        self._torn = False
        self._file = path.open("r+b" if keep else "wb", buffering=0)
        if keep:
            self._cut()

    def add(self, piece: bytes) -> None:
        """Append a whole piece, or nothing if that fails."""
        if self._torn:
            self._cut()
        left = memoryview(piece)
        try:
            while left:
                left = left[self._file.write(left) :]
        except BaseException:
            self._torn = True
            with suppress(OSError):
                self._cut()
            raise
        self._size += len(piece)

    @property
    def size(self) -> int:
        """Size in bytes."""
        return self._size

    def close(self) -> None:
        """Close the file; may be called again."""
        self._file.close()

    def _cut(self) -> None:
        self._file.truncate(self._size)
        self._file.seek(self._size)
        self._torn = False


class WriteGaps:
    """Handling of a file that cannot be written: data is skipped, and the beginning and end of the gap are reported.

    place: name of the file for messages. kept, done: words for the data and the action, such as "values" and "logged".
    goes_on: word for what continues, such as "polling". tell: called at each beginning and end of a gap.
    """

    def __init__(self, place: str, *, kept: str, done: str, goes_on: str, tell: Callable[[str], None]) -> None:
        self.missing = 0
        """Total number of entries that were not written."""
        self._place, self._kept, self._done, self._goes_on = place, kept, done, goes_on
        self._tell = tell
        self._gap = 0
        self._tried_s = 0.0

    def write(self, write: Callable[[], object], time_s: float) -> bool:
        """Write, unless an attempt failed just before; return whether it succeeded.

        time_s: present time in seconds since 1970.
        """
        if self._gap and 0 <= time_s - self._tried_s < TRIED_AGAIN_S:
            self._count()
            return False
        try:
            write()
        except OSError as error:
            self._tried_s = time_s
            if not self._gap:
                reason = _REASONS.get(error.errno or 0, error.strerror or str(error))
                self._tell(
                    f"{self._place}: {reason}; {self._kept} are not {self._done} from {_clock(time_s)} on; "
                    f"{self._goes_on} continues"
                )
            self._count()
            return False
        if self._gap:
            self._tell(
                f"{self._place}: {self._kept} are {self._done} again from {_clock(time_s)} on; {self._gap} are missing"
            )
            self._gap = 0
        return True

    @property
    def summary(self) -> str:
        """Final sentence about the missing data, "" if nothing is missing."""
        return f"{self._place}: is incomplete; {self.missing} {self._kept} are missing" if self.missing else ""

    def _count(self) -> None:
        self._gap += 1
        self.missing += 1


def _clock(time_s: float) -> str:
    return datetime.fromtimestamp(time_s).astimezone().strftime("%H:%M:%S")
