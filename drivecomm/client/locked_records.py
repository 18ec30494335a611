"""Record files that a process keeps locked while it lives; the record of a killed process is unlocked and ignored."""

from __future__ import annotations

import json
import os
import time
from contextlib import suppress
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

_LONGEST = 1 << 20
# A reader holds the lock only for an instant.
_LOCK_S = 1.0
_TRY_AGAIN_S = 0.01
_READS = 3
_LOCKED_BYTE = 1 << 30
# Windows has neither flag. A link is not followed, and a pipe without another end does not block.
_PLAIN_FILE = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)


class HeldRecord:
    """Record that this process keeps locked until it is released."""

    def __init__(self, path: Path, descriptor: int) -> None:
        self.path = path
        self._descriptor = descriptor

    def write(self, content: Mapping[str, Any]) -> None:
        """Replace the content of the record. Raises OSError."""
        data = json.dumps(content).encode()
        os.lseek(self._descriptor, 0, os.SEEK_SET)
        os.write(self._descriptor, data)
        os.ftruncate(self._descriptor, len(data))

    def release(self) -> None:
        """Remove the file and release its lock."""
        # Removed before the unlock, so no record of another process is removed; Windows cannot remove an open file.
        with suppress(OSError):
            self.path.unlink()
        os.close(self._descriptor)
        if os.name != "posix":
            with suppress(OSError):
                self.path.unlink()


def lock_record(path: Path) -> HeldRecord | None:
    """Lock a record, and create it if it is missing; None if another process holds it. Raises OSError."""
    until = time.monotonic() + _LOCK_S
    while True:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | _PLAIN_FILE, 0o600)
        try:
            if _take(descriptor) and _is_still(path, descriptor):
                return HeldRecord(path, descriptor)
        except BaseException:
            os.close(descriptor)
            raise
        os.close(descriptor)
        if time.monotonic() >= until:
            return None
        time.sleep(_TRY_AGAIN_S)


def read_locked_record(path: Path) -> dict[str, Any] | None:
    """Return the content of a record that a process holds; None for any other file."""
    try:
        descriptor = os.open(path, os.O_RDONLY | _PLAIN_FILE)
    except OSError:
        return None
    try:
        return _content(descriptor)
    except OSError:
        return None
    finally:
        os.close(descriptor)


def _content(descriptor: int) -> dict[str, Any] | None:
    for _ in range(_READS):
        if not _is_held(descriptor):
            return None
        os.lseek(descriptor, 0, os.SEEK_SET)
        try:
            content = json.loads(os.read(descriptor, _LONGEST))
        except ValueError:
            # The holder may be writing the record at this moment.
            time.sleep(_TRY_AGAIN_S)
        else:
            return content if isinstance(content, dict) else None
    return None


def _is_held(descriptor: int) -> bool:
    try:
        import fcntl
    except ImportError:
        return not _locks_a_byte(descriptor, for_good=False)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError:
        return True
    return False


def _take(descriptor: int) -> bool:
    try:
        import fcntl
    except ImportError:
        return _locks_a_byte(descriptor, for_good=True)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _locks_a_byte(descriptor: int, *, for_good: bool) -> bool:
    """Lock a record on Windows by a byte far beyond its content, so that the content stays readable for all."""
    windows: Any = import_module("msvcrt")
    os.lseek(descriptor, _LOCKED_BYTE, os.SEEK_SET)
    try:
        windows.locking(descriptor, windows.LK_NBLCK, 1)
        if not for_good:
            windows.locking(descriptor, windows.LK_UNLCK, 1)
    except OSError:
        return False
    finally:
        os.lseek(descriptor, 0, os.SEEK_SET)
    return True


def _is_still(path: Path, descriptor: int) -> bool:
    """Return whether the locked file still has this path, since the release of a record removes its file."""
    try:
        return os.path.samestat(os.stat(path), os.fstat(descriptor))  # noqa: PTH116
    except OSError:
        return False
