"""Test stand: one line with the judged drive, served to the master in real time, with its trace."""

from __future__ import annotations

import tempfile
import time
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Self

from drivecomm.judge.pseudo_terminal import reconfigurable
from drivecomm.testing import ServingThread
from drivecomm.virtual import SERVED_TOLERANCE_S, LineTrace, Server, ViolationLog, parse_listen

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from drivecomm.judge.judged_drive import JudgedDrive
    from drivecomm.judge.process import Run
    from drivecomm.protocol import VirtualDrive
    from drivecomm.virtual import Listener, Violation, VirtualLine

_LOOK_S = 0.005


class TelegramMeddler:
    """Disturbance of telegrams on their way, in addition to the drive's own, as for `VirtualLine.disturbances`.

    on_request, on_reply: called with the bytes; return what arrives, as pairs of delay and bytes.
    """

    def __init__(self) -> None:
        self.on_request: Callable[[bytes], Sequence[tuple[float, bytes]]] = lambda data: [(0.0, data)]
        self.on_reply: Callable[[bytes], Sequence[tuple[float, bytes]]] = lambda data: [(0.0, data)]

    def request(self, data: bytes, now: float) -> Sequence[tuple[float, bytes]]:  # noqa: ARG002 - signature required by the line
        """Return the parts of a request that arrive, as pairs of delay and bytes."""
        return self.on_request(data)

    def reply(self, data: bytes, drive: VirtualDrive, now: float) -> Sequence[tuple[float, bytes]]:  # noqa: ARG002
        """Return the parts of a reply that arrive, as pairs of delay and bytes."""
        return self.on_reply(data)


@contextmanager
def listener_at(listen: str) -> Iterator[Listener]:
    """Yield a listener that is not open yet. listen: pty, tcp or rfc2217 for a new address, or an address."""
    if listen in ("tcp", "rfc2217"):
        yield parse_listen(f"{listen}:127.0.0.1:0")
    elif listen == "pty":
        with tempfile.TemporaryDirectory(prefix="drivecomm-judge-") as folder:
            yield parse_listen(f"pty:{Path(folder) / 'port'}")
    else:
        yield parse_listen(listen)


class JudgeLine:
    """A served line. listen: as for `listener_at`, or a listener. echo: the master receives its own bytes."""

    def __init__(self, drive: JudgedDrive, listen: str | Listener, *, echo: bool = False) -> None:
        self.drive = drive
        self.meddler = TelegramMeddler()
        self.runs: list[Run] = []
        self._listen = listen
        self._echo = echo
        self._open = ExitStack()
        self._server: Server | None = None
        self._thread: ServingThread | None = None
        self._trace: LineTrace | None = None

    def __enter__(self) -> Self:
        with ExitStack() as opened:
            listen = self._listen
            listener = opened.enter_context(listener_at(listen)) if isinstance(listen, str) else listen
            server = Server([self.drive], listener, echo=self._echo, paced=True)
            server.line.disturbances.append(self.meddler)
            log = ViolationLog(server.line, [self.drive.rules], tolerance_s=SERVED_TOLERANCE_S)
            self._trace = LineTrace(server.line, log)
            self._server = server
            self._thread = ServingThread(server)
            opened.callback(self._thread.close)
            if "://" not in server.address:
                opened.enter_context(reconfigurable(server.address))
            self._open = opened.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._open.close()

    @property
    def line(self) -> VirtualLine:
        """The virtual line; only the thread that serves it may change it."""
        return self._served.line

    @property
    def port(self) -> str:
        """The port for the master to open."""
        return self._served.address

    @property
    def trace(self) -> str:
        """The decoded traffic of the line."""
        return "" if self._trace is None else self._trace.text()

    @property
    def violations(self) -> tuple[Violation, ...]:
        """Violations of timing and line settings by the master."""
        return () if self._trace is None else self._trace.violations.found

    def now(self) -> float:
        """Return the time on the clock of the line."""
        return self._served.now()

    def later(self, delay_s: float, action: Callable[[], None]) -> None:
        """Call a function on the line after a delay; must be called by the line's own thread."""
        self.line.call_at(self.line.time + delay_s, action)

    def comes_about(self, condition: Callable[[], bool], within_s: float) -> bool:
        """Wait until a condition is met; return whether it was met within this time."""
        ends = time.monotonic() + within_s
        while not condition():
            if time.monotonic() >= ends:
                return False
            time.sleep(_LOOK_S)
        return True

    def power(self, *, on: bool) -> None:
        """Switch the drive's mains; may be called by any thread."""
        line, drive = self.line, self.drive

        def switch() -> None:
            if line.has_power(drive) is not on:
                (line.power_on if on else line.power_off)(drive)

        with drive.alone:
            line.call_at(line.time, switch)
        self.comes_about(lambda: line.has_power(drive) is on, 5.0)

    @property
    def _served(self) -> Server:
        if self._server is None:
            raise RuntimeError("the line is not served yet")
        return self._server
