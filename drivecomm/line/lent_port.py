"""Temporary loan of a port, which can be taken back at any moment."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.link import PortProxy

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.link import Port

LOOK_S = 0.02
"""Interval in seconds between checks whether the port is taken back."""


class LentPort(PortProxy):
    """Port that is lent until it is taken back.

    check: called before and during every operation; raises from then on.
    """

    def __init__(self, port: Port, check: Callable[[], None]) -> None:
        super().__init__(port)
        self._check = check

    def write(self, data: bytes) -> None:
        """Hand over bytes for sending."""
        self._check()
        super().write(data)

    def read(self, until: float, at_least: int) -> bytes:
        """Return the received bytes, as `Port.read` does."""
        came = b""
        while True:
            self._check()
            came += super().read(min(until, self.now() + LOOK_S), at_least - len(came))
            if len(came) >= at_least or self.now() >= until:
                return came

    def wait(self, until: float) -> None:
        """Wait until this time."""
        while self.now() < until:
            self._check()
            super().wait(min(until, self.now() + LOOK_S))
