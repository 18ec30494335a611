"""Standard output and standard error that do not raise: where all that the command line says leaves the process.

What cannot be written because nobody reads it, the disk is full or the terminal has gone is lost, and the command goes
on: it may be stopping a motor. A command that only reads ends then, as by Ctrl-C. A character that an encoding lacks is
written as its number.
"""

from __future__ import annotations

import errno
import io
import os
import sys
from contextlib import suppress
from threading import current_thread, main_thread

# What a shell takes for "nobody read it any more", as of any program that is ended by SIGPIPE.
NOT_READ = 141
NOT_WRITTEN = 1


class _Stream(io.TextIOWrapper):
    """A standard stream. lost: why what is written gets nowhere any more. reads: the command only reads."""

    lost: OSError | None = None
    reads = True
    _ended = False

    def write(self, text: str, /) -> int:
        try:
            super().write(text)
        except OSError as error:
            self._lose(error)
        self._end_reading()
        return len(text)

    def flush(self) -> None:
        try:
            super().flush()
        except OSError as error:
            self._lose(error)
        self._end_reading()

    def _lose(self, error: OSError) -> None:
        self.lost = self.lost or error
        with suppress(OSError):
            # What is in the buffers would be tried again, at the very end of the process too.
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self.fileno())
            os.close(nowhere)

    def _end_reading(self) -> None:
        if self.lost and self.reads and not self._ended and current_thread() is main_thread():
            self._ended = True
            raise KeyboardInterrupt


def guard() -> None:
    """Put such streams in the place of those that this process was started with."""
    # A descriptor that is missing would be given to the next thing opened: a port, that would then be printed to.
    while (descriptor := os.open(os.devnull, os.O_RDWR)) <= 2:
        pass
    os.close(descriptor)
    if sys.stdin is None:
        sys.stdin = sys.__stdin__ = open(0, encoding="utf-8", closefd=False)  # type: ignore[misc]  # noqa: SIM115
    # Their originals hold nothing any more, and would be asked to write it at the end.
    sys.stdout = sys.__stdout__ = _guarded(sys.stdout, 1)  # type: ignore[misc]
    sys.stderr = sys.__stderr__ = _guarded(sys.stderr, 2)  # type: ignore[misc]
    sys.stderr.reads = False


def begin(*, reads: bool) -> None:
    """Say whether the command that begins only reads, so that it ends when what it says cannot be written."""
    if isinstance(sys.stdout, _Stream):
        sys.stdout.reads = reads


def is_lost() -> bool:
    """Whether standard output cannot be written any more."""
    return isinstance(sys.stdout, _Stream) and sys.stdout.lost is not None


def finished(code: int) -> int:
    """Write what is left, and return the exit code: that of the command, or, where it only reads, of what was lost."""
    out = sys.stdout
    if not isinstance(out, _Stream):
        return code
    reads, out.reads = out.reads, False
    out.flush()
    if out.lost is None:
        return code
    # Windows has no name of its own for it.
    not_read = isinstance(out.lost, ConnectionError) or (os.name == "nt" and out.lost.errno == errno.EINVAL)
    if not not_read:
        sys.stderr.write(f"drivecomm: standard output cannot be written: {out.lost.strerror or out.lost}\n")
    return code or ((NOT_READ if not_read else NOT_WRITTEN) if reads else 0)


def _guarded(stream: object, descriptor: int) -> _Stream:
    if isinstance(stream, io.TextIOWrapper):
        encoding, by_line, at_once = stream.encoding, stream.line_buffering, stream.write_through
        buffer = stream.detach()
    else:
        encoding, by_line, at_once = "utf-8", False, False
        buffer = open(descriptor, "wb", closefd=False)  # noqa: SIM115
    return _Stream(buffer, encoding=encoding, errors="backslashreplace", line_buffering=by_line, write_through=at_once)
