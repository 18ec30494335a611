"""A port that a bus lends for a while: it fails as soon as a stop waits for the line."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.errors import LinkDownError
from drivecomm.link import PortProxy

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.link import Port

LOOK_S = 0.02
"""How often it is looked whether a stop waits."""


class LentPort(PortProxy):
    """A port that somebody has for a while. taken_back: whether the while is over; then all raises LinkDownError."""

    def __init__(self, port: Port, taken_back: Callable[[], bool]) -> None:
        super().__init__(port)
        self._taken_back = taken_back

    def write(self, data: bytes) -> None:
        """Send."""
        self._check()
        super().write(data)

    def read(self, until: float, at_least: int) -> bytes:
        """Return what comes."""
        while True:
            self._check()
            came = super().read(min(until, self.now() + LOOK_S), at_least)
            if came or self.now() >= until:
                return came

    def wait(self, until: float) -> None:
        """Let time pass."""
        while self.now() < until:
            self._check()
            super().wait(min(until, self.now() + LOOK_S))

    def _check(self) -> None:
        if self._taken_back():
            raise LinkDownError("the port was given back in the middle, because a stop goes first")
