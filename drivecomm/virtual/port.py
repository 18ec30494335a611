"""The master's end of a virtual line, as a port: its clock is the line's, and waiting costs nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from drivecomm.errors import LinkDownError

if TYPE_CHECKING:
    from drivecomm.protocol import LineSettings


class PortLine(Protocol):
    """A line whose time passes while its master waits, as `drivecomm.virtual.VirtualLine` says."""

    time: float
    paced: bool
    broken: bool

    def configure(self, settings: LineSettings) -> None: ...  # noqa: D102 - as the line says
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
        """Send."""
        self._check()
        self._line.transmit(data)

    def read(self, until: float, at_least: int) -> bytes:
        """Let time pass until this many bytes have come, or until then."""
        self._check()
        return self._line.receive(until, at_least)

    def wait(self, until: float) -> None:
        """Let time pass."""
        self._check()
        self._line.pass_time(until)

    def take(self) -> bytes:
        """Return what has come by now; no time passes."""
        self._check()
        return self._line.take()

    def hold_back(self, at_least: int) -> None:
        """Nothing to hold back: there is no descriptor."""

    def close(self) -> None:
        """Nothing to give back."""

    def _check(self) -> None:
        if self._line.broken:
            raise LinkDownError("the virtual line is broken; set broken to False to repair it")
