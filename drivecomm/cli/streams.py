"""Standard output and standard error that never raise an error, for all output of the command line.

Output is lost if its reader is gone, the disk is full or the terminal is closed. The command then continues, because it
may be stopping a motor; only a command that only reads ends, as by Ctrl-C. A character that the encoding lacks is
written as its number.
"""

from __future__ import annotations

import errno
import io
import os
import sys
from contextlib import suppress
from threading import current_thread, main_thread

# Exit code that shells expect of a program whose output is no longer read, as after SIGPIPE.
NOT_READ = 141
NOT_WRITTEN = 1


class _Stream(io.TextIOWrapper):
    """Standard stream. lost: the error after which its output is lost. reads: whether the command only reads."""

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
            # Buffered output would otherwise be retried, even at the very end of the process.
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self.fileno())
            os.close(nowhere)

    def _end_reading(self) -> None:
        if self.lost and self.reads and not self._ended and current_thread() is main_thread():
            self._ended = True
            raise KeyboardInterrupt


def guard() -> None:
    """Replace the standard streams of this process with streams that never raise errors."""
    # A missing descriptor would be reused for the next file opened, such as a port, which would then get the output.
    while (descriptor := os.open(os.devnull, os.O_RDWR)) <= 2:
        pass
    os.close(descriptor)
    if sys.stdin is None:
        sys.stdin = sys.__stdin__ = open(0, encoding="utf-8", closefd=False)  # type: ignore[misc]  # noqa: SIM115
    # The original streams are empty now, and would still be flushed at exit.
    sys.stdout = sys.__stdout__ = _guarded(sys.stdout, 1)  # type: ignore[misc]
    sys.stderr = sys.__stderr__ = _guarded(sys.stderr, 2)  # type: ignore[misc]
    sys.stderr.reads = False


def begin(*, reads: bool) -> None:
    """Mark the beginning of a command. reads: whether it only reads, so that it ends when its output is lost."""
    if isinstance(sys.stdout, _Stream):
        sys.stdout.reads = reads


def is_lost() -> bool:
    """Return whether the standard output is lost."""
    return isinstance(sys.stdout, _Stream) and sys.stdout.lost is not None


def finished(code: int) -> int:
    """Flush the output, and return the exit code of the command; of a lost output if the command only reads."""
    out = sys.stdout
    if not isinstance(out, _Stream):
        return code
    reads, out.reads = out.reads, False
    out.flush()
    if out.lost is None:
        return code
    # Windows reports a closed pipe with this general error code.
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
