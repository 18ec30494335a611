"""The file of an audit: append-only lines, on the disk when `add` returns; full files are rotated."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

FILE_BYTES = 10_000_000
FILES = 10
"""Number of full files that are retained; audit.jsonl.1 is the latest."""


class AuditFile:
    """An append-only file of lines that is rotated when full; used from one thread.

    file_bytes: size at which it is full. files: number of full files retained, as PATH.1 and so on, the latest first.
    """

    def __init__(self, path: Path, file_bytes: int = FILE_BYTES, files: int = FILES) -> None:
        self.path = path
        self._file_bytes, self._files = file_bytes, files
        self._descriptor: int | None = None

    def add(self, lines: Sequence[bytes]) -> None:
        """Append lines; return when they are on the disk. Raises OSError; some of the lines may then be in the file."""
        try:
            size = self._open()
            if size >= self._file_bytes:
                self._make_room()
                self._open()
            left = memoryview(b"".join(lines))
            while left:
                left = left[os.write(self._opened, left) :]
            if lines:
                os.fsync(self._opened)
        except OSError:
            # The next `_open` repairs a line that was written in part.
            self.close()
            raise

    def close(self) -> None:
        """Close the file; the next `add` opens it again."""
        descriptor, self._descriptor = self._descriptor, None
        if descriptor is not None:
            with suppress(OSError):
                os.close(descriptor)

    @property
    def _opened(self) -> int:
        if self._descriptor is None:
            raise OSError("the file is closed")
        return self._descriptor

    def _open(self) -> int:
        """Open the file unless it is open; return its size. Completes a line that was cut off, as by a kill."""
        if self._descriptor is not None and not self._still_there(self._descriptor):
            self.close()
        if self._descriptor is None:
            self.path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            flags = os.O_RDWR | os.O_APPEND | os.O_CREAT | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)
            self._descriptor = os.open(self.path, flags, 0o600)
            size = os.fstat(self._descriptor).st_size
            if size:
                os.lseek(self._descriptor, -1, os.SEEK_END)
                if os.read(self._descriptor, 1) != b"\n":
                    os.write(self._descriptor, b"\n")
            else:
                _sync_folder(self.path.parent)
        return os.fstat(self._descriptor).st_size

    def _still_there(self, descriptor: int) -> bool:
        """Return whether the path still leads to the open file, which may have been moved or removed."""
        try:
            return os.path.samestat(os.fstat(descriptor), self.path.stat())
        except OSError:
            return False

    def _make_room(self) -> None:
        """Rotate the files: the current one becomes PATH.1 and the others move up by one; keep the file on failure.

        After a kill in the middle of a rotation a number is free. Files behind that number need not move, so none is
        dropped too early.
        """
        self.close()
        names = [self.path, *(Path(f"{self.path}.{number}") for number in range(1, self._files + 1))]
        free = next((number for number, name in enumerate(names) if not name.exists()), self._files)
        with suppress(OSError):
            for number in range(free, 0, -1):
                names[number - 1].replace(names[number])


def _sync_folder(folder: Path) -> None:
    """Make sure that a new file survives a power failure, by syncing its folder where the system supports that."""
    if os.name == "posix":
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            with suppress(OSError):
                os.fsync(descriptor)
        finally:
            os.close(descriptor)
