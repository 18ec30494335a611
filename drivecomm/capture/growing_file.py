"""Files that grow while something else goes on: whole pieces only, and a disk that is full ends nothing."""

from __future__ import annotations

import errno
from contextlib import suppress
from datetime import datetime
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

TRIED_AGAIN_S = 5.0
"""How long to wait before a file that could not be written is tried again."""

_REASONS = {
    errno.ENOSPC: "no space left on the device",
    errno.EDQUOT: "the disk quota is used up",
    errno.EFBIG: "the file may not grow any further",
    errno.EIO: "the device cannot be written",
}


class GrowingFile:
    """A file that whole pieces are added to: one that could not be written to its end is taken away again.

    keep: how many of the bytes that are there stay. Unbuffered, so that what was added is with the operating system.
    Raises OSError, as its methods do.
    """

    def __init__(self, path: Path, keep: int = 0) -> None:
        self._size = keep
        self._torn = False
        self._file = path.open("r+b" if keep else "wb", buffering=0)
        if keep:
            self._cut()

    def add(self, piece: bytes) -> None:
        """Add a piece, or nothing of it."""
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
        """How many bytes it has."""
        return self._size

    def close(self) -> None:
        """Close the file; may be called again."""
        self._file.close()

    def _cut(self) -> None:
        self._file.truncate(self._size)
        self._file.seek(self._size)
        self._torn = False


class Gaps:
    """Lets what is kept in a file go missing while the file cannot be written, and says when that begins and ends.

    place: the file, as messages name it. kept, done: what goes missing, and what is not done with it: "values"
    and "logged". goes_on: what does not end by it, such as "polling". tell: hears each beginning and end.
    """

    def __init__(self, place: str, *, kept: str, done: str, goes_on: str, tell: Callable[[str], None]) -> None:
        self.missing = 0
        """How many were not written, of all."""
        self._place, self._kept, self._done, self._goes_on = place, kept, done, goes_on
        self._tell = tell
        self._gap = 0
        self._tried_s = 0.0

    def write(self, write: Callable[[], object], time_s: float) -> bool:
        """Write, unless that failed just before; return whether it was written. time_s: now, in seconds since 1970."""
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
                    f"{self._goes_on} goes on"
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
        """What is to be said at the end, empty where nothing is missing."""
        return f"{self._place}: is incomplete; {self.missing} {self._kept} are missing" if self.missing else ""

    def _count(self) -> None:
        self._gap += 1
        self.missing += 1


def _clock(time_s: float) -> str:
    return datetime.fromtimestamp(time_s).astimezone().strftime("%H:%M:%S")
