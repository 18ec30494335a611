"""Where a watched line is: in the test's own process in virtual time, or served to other programs in real time."""

from __future__ import annotations

import time
from functools import partial
from typing import TYPE_CHECKING, Protocol

from drivecomm.capture import Piece
from drivecomm.errors import UsageError
from drivecomm.testing.serving_thread import ServingThread
from drivecomm.virtual import Server, parse_listen

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from drivecomm.capture import Source
    from drivecomm.plant import FaultPlan
    from drivecomm.protocol import VirtualDrive
    from drivecomm.testing.attached_trace import LineTrace
    from drivecomm.virtual import Transmission, VirtualLine, VirtualPort

_STEP_S = 0.005
"""How often it is looked whether something has come about, in the time of the line."""


class Site(Protocol):
    """A line with its clock."""

    @property
    def port(self) -> str | Callable[[], VirtualPort]:
        """What a master opens: a path, a URL, or what `open_bus` calls to open a port."""
        ...

    @property
    def virtual(self) -> VirtualLine:
        """The line itself. Raises UsageError where there is none in this process."""
        ...

    def now(self) -> float:
        """Return the time on the line's clock, in seconds."""
        ...

    def passes(self, seconds: float) -> None:
        """Let time pass."""
        ...

    def close(self) -> None:
        """Leave nothing behind, and raise what went wrong meanwhile."""
        ...


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
    trace.add(piece, spoilt=sent.garbled)


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


def comes_about(site: Site, condition: Callable[[], bool], within_s: float) -> bool:
    """Return whether this is so, or becomes so within a time of the line."""
    until = site.now() + within_s
    while not condition():
        left = until - site.now()
        if left <= 0:
            return False
        site.passes(min(_STEP_S, left))
    return True
