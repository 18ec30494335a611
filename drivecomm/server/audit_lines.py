"""The file of an audit: lines that are only added, and on the disk when that returns; full files are kept."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

FILE_BYTES = 10_000_000
FILES = 10
"""So many full files are kept, audit.jsonl.1 the latest of them."""


class AuditFile:
    """A file of lines that is only added to, and that makes room for a new one when it is full; used from one thread.

    file_bytes: when it is full. files: how many full ones are kept, as PATH.1 and so on, the latest first.
    """

    def __init__(self, path: Path, file_bytes: int = FILE_BYTES, files: int = FILES) -> None:
        self.path = path
        self._file_bytes, self._files = file_bytes, files
        self._descriptor: int | None = None

    def add(self, lines: Sequence[bytes]) -> None:
        """Add lines, and return when they are on the disk. Raises OSError; what was written of them then may stay."""
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
            # What stands there now is found out when it is opened again.
            self.close()
            raise

    def close(self) -> None:
        """Close the file; it is opened again by what is added."""
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
        """Open the file unless it is open; return its size. A line that was cut off, as by a kill, is ended."""
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
        """Whether nobody has moved the file away, or removed it."""
        try:
            return os.path.samestat(os.fstat(descriptor), self.path.stat())
        except OSError:
            return False

    def _make_room(self) -> None:
        """Give the file its number, and those before it the next ones; where that cannot be, it goes on growing.

        Where a kill came between, a number is free: what is behind it need not move, so nothing goes too early.
        """
        self.close()
        names = [self.path, *(Path(f"{self.path}.{number}") for number in range(1, self._files + 1))]
        free = next((number for number, name in enumerate(names) if not name.exists()), self._files)
        with suppress(OSError):
            for number in range(free, 0, -1):
                names[number - 1].replace(names[number])


def _sync_folder(folder: Path) -> None:
    """See to it that a new file is found in its folder also after the power has failed, where the system has a way."""
    if os.name == "posix":
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            with suppress(OSError):
                os.fsync(descriptor)
        finally:
            os.close(descriptor)
