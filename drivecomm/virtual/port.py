"""The master's end of a virtual line as a port, whose clock is the line's and whose waiting takes no real time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from drivecomm.errors import LinkDownError

if TYPE_CHECKING:
    from drivecomm.protocol import LineSettings


class PortLine(Protocol):
    """A line whose time passes while its master waits, such as `drivecomm.virtual.VirtualLine`."""

    time: float
    paced: bool
    broken: bool

    def configure(self, settings: LineSettings) -> None: ...  # noqa: D102 - documented in VirtualLine
    def transmit(self, data: bytes) -> None: ...  # noqa: D102
    def receive(self, until: float, at_least: int) -> bytes: ...  # noqa: D102
    def take(self) -> bytes: ...  # noqa: D102
    def pass_time(self, until: float) -> None: ...  # noqa: D102


class VirtualPort:
    """The master's end of a virtual line."""

    real_time = False
    descriptor = None

    def __init__(self, line: PortLine) -> None:
        self._line = line
        self.paced = line.paced
        self._check()

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of {self._line!r}>"

    def now(self) -> float:
        """Return the line's time."""
        return self._line.time

    def wall_time(self) -> float:
        """Return the line's time."""
        return self._line.time

    def configure(self, settings: LineSettings) -> str:
        """Set the master's line settings."""
        self._check()
        self._line.configure(settings)
        return ""

    def write(self, data: bytes) -> None:
        """Send bytes."""
        self._check()
        self._line.transmit(data)

    def read(self, until: float, at_least: int) -> bytes:
        """Pass time until this many bytes have arrived, or until the given time; return the bytes."""
        self._check()
        return self._line.receive(until, at_least)

    def wait(self, until: float) -> None:
        """Pass time until the given time."""
        self._check()
        self._line.pass_time(until)

    def take(self) -> bytes:
        """Return the bytes that have arrived by now; no time passes."""
        self._check()
        return self._line.take()

    def hold_back(self, at_least: int) -> None:
        """Do nothing, because there is no descriptor."""

    def close(self) -> None:
        """Do nothing, because the port holds no resources."""

    def _check(self) -> None:
        if self._line.broken:
            raise LinkDownError("the virtual line is broken; set broken to False to repair it")
