"""Where a watched line is: in the test's own process in virtual time, or served to other programs in real time."""

from __future__ import annotations

import time
from functools import partial
from threading import Event, Thread
from typing import TYPE_CHECKING, TypeAlias

from drivecomm.capture import Piece
from drivecomm.errors import UsageError
from drivecomm.virtual import Server, parse_listen

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from drivecomm.capture import Source
    from drivecomm.plant import FaultPlan
    from drivecomm.protocol import VirtualDrive
    from drivecomm.testing.line_trace import LineTrace
    from drivecomm.virtual import PlantServer, Transmission, VirtualLine, VirtualPort


class InProcess:
    """A line in virtual time: it passes while the master waits, and here while somebody else does."""

    def __init__(self, line: VirtualLine, trace: LineTrace) -> None:
        self.virtual = line
        line.monitor = partial(note, trace)

    @property
    def port(self) -> Callable[[], VirtualPort]:
        """What `open_bus` calls to open a port."""
        return self.virtual.port

    def now(self) -> float:
        """Return the time on the line's clock."""
        return self.virtual.time

    def passes(self, seconds: float) -> None:
        """Let time pass; nobody waits."""
        self.virtual.advance(seconds)

    def close(self) -> None:
        """Nothing to give back."""


_SOURCES: dict[str, Source] = {"master": "master", "drive": "drive"}


def note(trace: LineTrace, sent: Transmission) -> None:
    """Note down what was on a virtual line."""
    piece = Piece(
        time_s=sent.ended,
        data=sent.data,
        source=_SOURCES.get(sent.source, "unknown"),
        # What a drive sends has the settings of that drive, which are no news; over plain TCP they are not known.
        settings=sent.settings if sent.source == "master" and not sent.agreed else None,
    )
    trace.add(piece, disturbed=sent.garbled)


class Served:
    """A line in real time that a thread serves. now: the seconds since it was made."""

    def __init__(self, address: str, now: Callable[[], float], thread: ServingThread) -> None:
        self._address = address
        self._thread = thread
        self.now = now

    @property
    def port(self) -> str:
        """The path or the URL that a master opens."""
        return self._address

    @property
    def virtual(self) -> VirtualLine:
        """Raise UsageError: what other programs see is no line that could be stopped or disturbed from here."""
        raise UsageError(f"the line at {self.port} is served in real time; make it without listen= for a VirtualLine")

    def passes(self, seconds: float) -> None:
        """Wait."""
        self._thread.check()
        time.sleep(seconds)

    def close(self) -> None:
        """End the thread and close the port; raise what ended the thread before."""
        self._thread.close()


def served(
    drives: Sequence[VirtualDrive],
    listen: str,
    *,
    faults: FaultPlan,
    echo: bool,
    paced: bool,
    trace: LineTrace,
) -> Served:
    """Serve drives at a place, in a thread of their own. Raises UsageError and PortError."""
    server = Server(drives, parse_listen(listen), echo=echo, paced=paced)
    server.line.faults = faults
    server.line.monitor = partial(note, trace)
    thread = ServingThread(server)
    return Served(server.address, server.now, thread)


Site: TypeAlias = InProcess | Served
"""A line with its clock."""


class ServingThread:
    """Serves from the beginning until it is closed. Raises PortError when a port cannot be had."""

    def __init__(self, server: Server | PlantServer) -> None:
        self._server = server
        self._stop = Event()
        self._error: BaseException | None = None
        server.__enter__()
        self._thread = Thread(target=self._serve, name="drivecomm virtual line", daemon=True)
        self._thread.start()

    def check(self) -> None:
        """Raise RuntimeError when serving has come to an end by an error."""
        if self._error is not None:
            raise RuntimeError(f"the virtual line is not served any more: {self._error!r}") from self._error

    def close(self) -> None:
        """End the thread and close the ports; raise the error that ended serving before. May be called again."""
        self._stop.set()
        self._thread.join()
        self._server.__exit__(None, None, None)
        error, self._error = self._error, None
        if error is not None:
            raise error

    def _serve(self) -> None:
        try:
            self._server.run(self._stop)
        except BaseException as error:  # noqa: BLE001 - told to the test, whose thread is another one
            self._error = error
