"""A port that somebody has for a while, and that can be taken back in the middle of what it does."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.link import PortProxy

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.link import Port

LOOK_S = 0.02
"""How often it is looked whether the port is taken back."""


class LentPort(PortProxy):
    """A port that is used until it is taken back. check: raises from then on; called before and during all it does."""

    def __init__(self, port: Port, check: Callable[[], None]) -> None:
        super().__init__(port)
        self._check = check

    def write(self, data: bytes) -> None:
        """Send."""
        self._check()
        super().write(data)

    def read(self, until: float, at_least: int) -> bytes:
        """Return what comes."""
        came = b""
        while True:
            self._check()
            came += super().read(min(until, self.now() + LOOK_S), at_least - len(came))
            if len(came) >= at_least or self.now() >= until:
                return came

    def wait(self, until: float) -> None:
        """Let time pass."""
        while self.now() < until:
            self._check()
            super().wait(min(until, self.now() + LOOK_S))
