"""The blocking runner: carries out the effects of a link on a port, one after the other.

Real time or virtual time is the port's affair: a virtual line's port has a virtual clock.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, TypeVar

from drivecomm.link import Arrival, Configure, Receive, Send

if TYPE_CHECKING:
    from drivecomm.line import LineSettings
    from drivecomm.link import Steps

T = TypeVar("T")


class Port(Protocol):
    """The seam between the link and whatever carries bytes. Everything may raise LinkDownError."""

    @property
    def paced(self) -> bool:
        """Whether characters take their time on it, as on a real line; False for a network or a pseudo-terminal."""
        ...

    def now(self) -> float:
        """Return the time on the clock that `until` arguments refer to, in seconds."""
        ...

    def wall_time(self) -> float:
        """Return the time for people: seconds since 1970, on a virtual line since its start."""
        ...

    def configure(self, settings: LineSettings) -> str:
        """Set the line settings; return a note when this port cannot carry all of them, otherwise nothing."""
        ...

    def write(self, data: bytes) -> None:
        """Hand over bytes for sending; returns before they are on the line."""
        ...

    def read(self, until: float, at_least: int) -> bytes:
        """Return all bytes that are there as soon as there are this many, at `until` with what there is."""
        ...

    def wait(self, until: float) -> None:
        """Let time pass."""
        ...

    def close(self) -> None:
        """Give the port back."""
        ...


def run(steps: Steps[T], port: Port) -> T:
    """Run a link's steps to their end on a port and return their result.

    An exception of the port, or Ctrl-C, closes the steps and passes through.
    """
    try:
        effect = next(steps)
        while True:
            data, note = b"", ""
            if isinstance(effect, Receive):
                data = port.read(effect.until, effect.at_least)
            elif isinstance(effect, Send):
                port.write(effect.data)
            elif isinstance(effect, Configure):
                note = port.configure(effect.settings)
            else:
                port.wait(effect.until)
            effect = steps.send(Arrival(port.now(), data, note))
    except StopIteration as finished:
        result: T = finished.value
        return result
    finally:
        steps.close()
