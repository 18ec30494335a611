"""One process of the judged master: started, recorded, and always ended together with all its child processes."""

from __future__ import annotations

import os
import signal
import subprocess
import time
import uuid
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from threading import Thread
from typing import IO, TYPE_CHECKING

from drivecomm.errors import UsageError, reason_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

_MOST_LINES = 2000
_LONGEST_LINE = 2000
_LOOK_S = 0.01
_GRACE_S = 2.0
_MARK = "DRIVECOMM_JUDGED"
"""Environment variable that marks child processes, even if they have left the process group."""


@dataclass(frozen=True, slots=True)
class OutputLine:
    """A line printed by the master, with its time; is_error: whether it went to standard error."""

    time_s: float
    text: str
    is_error: bool


@dataclass(slots=True, kw_only=True)
class Run:
    """One run of the master.

    code: its exit code, negative for a signal; None if it was ended from outside. began_s, ended_s: on the clock of the
    line. too_long: whether its time limit ended it. lines: the first 2000.
    """

    words: Sequence[str] = ()
    began_s: float = 0.0
    ended_s: float = 0.0
    code: int | None = None
    too_long: bool = False
    lines: list[OutputLine] = field(default_factory=list)

    @property
    def output(self) -> str:
        """Standard output of the run."""
        return "\n".join(line.text for line in self.lines if not line.is_error)

    @property
    def text(self) -> str:
        """Standard output and standard error of the run."""
        return "\n".join(line.text for line in self.lines)


class Process:
    """A running master. clock: returns the time for its printed lines. Raises UsageError if it cannot be started."""

    def __init__(self, words: Sequence[str], environment: Mapping[str, str], clock: Callable[[], float]) -> None:
        self.run = Run(words=tuple(words), began_s=clock())
        self._clock = clock
        self._mark = uuid.uuid4().hex
        try:
            self._popen = subprocess.Popen(  # noqa: S603 - the user's own command
                list(words),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                env={**os.environ, **environment, "PYTHONUNBUFFERED": "1", _MARK: self._mark},
                start_new_session=True,
            )
        except OSError as error:
            raise UsageError(f"the master {words[0]!r} cannot be started: {reason_of(error)}") from error
        self._readers = [
            Thread(target=self._read, args=(stream, is_error), name="drivecomm judge", daemon=True)
            for stream, is_error in ((self._popen.stdout, False), (self._popen.stderr, True))
        ]
        for reader in self._readers:
            reader.start()

    def wait(self, limit_s: float, until: Callable[[], bool] = lambda: False) -> bool:
        """Wait until the process ends or a condition is met; return False if the limit passes first."""
        ends = time.monotonic() + limit_s
        while self._popen.poll() is None and not until():
            left_s = ends - time.monotonic()
            if left_s <= 0:
                return False
            with suppress(subprocess.TimeoutExpired):
                self._popen.wait(min(_LOOK_S, left_s))
        return True

    @property
    def has_ended(self) -> bool:
        """Whether the process has ended by itself."""
        return self._popen.poll() is not None

    def kill(self) -> None:
        """Kill the master immediately, as a crash of its machine would."""
        self._popen.kill()
        self._popen.wait()

    def end(self, *, too_long: bool = False) -> Run:
        """End the process and all its child processes; return its run."""
        run = self.run
        if self.has_ended:
            run.code = self._popen.returncode
        else:
            self._signal(signal.SIGTERM)
            with suppress(subprocess.TimeoutExpired):
                self._popen.wait(_GRACE_S)
        run.too_long = too_long
        run.ended_s = self._clock()
        self._kill_all()
        self._popen.wait()
        for reader in self._readers:
            reader.join(_GRACE_S)
        for stream in (self._popen.stdout, self._popen.stderr):
            if stream is not None and not any(reader.is_alive() for reader in self._readers):
                stream.close()
        return run

    def _signal(self, number: int) -> None:
        if os.name == "posix":
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(self._popen.pid, number)
        else:
            self._popen.terminate()

    def _kill_all(self) -> None:
        if os.name != "posix":
            self._popen.kill()
            return
        self._signal(signal.SIGKILL)
        mark = f"{_MARK}={self._mark}".encode()
        for folder in Path("/proc").glob("[0-9]*"):
            with suppress(OSError):
                if mark in (folder / "environ").read_bytes().split(b"\0"):
                    os.kill(int(folder.name), signal.SIGKILL)

    def _read(self, stream: IO[bytes] | None, is_error: bool) -> None:
        if stream is None:
            return
        with suppress(ValueError):
            while data := stream.readline(_LONGEST_LINE):
                if len(self.run.lines) < _MOST_LINES:
                    text = data.decode("utf-8", "replace").rstrip("\r\n")
                    self.run.lines.append(OutputLine(self._clock(), text, is_error))
