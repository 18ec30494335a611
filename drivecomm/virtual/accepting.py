"""Accepting connections without ever being kept busy by one that cannot be accepted."""

from __future__ import annotations

import errno
import os
from contextlib import suppress
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import socket

_EXHAUSTED = (errno.EMFILE, errno.ENFILE)


class Accepting:
    """Accepts connections; while no descriptor is left, newcomers are turned away by one that is kept for that.

    Otherwise the listening socket would stay readable, and whoever waits for it would wait no longer.
    """

    def __init__(self) -> None:
        self._spare: int | None = None

    def open(self) -> None:
        """Keep a descriptor, as far as there is one."""
        with suppress(OSError):
            self._spare = os.open(os.devnull, os.O_RDONLY)

    def next(self, server: socket.socket) -> socket.socket | None:
        """Return the next connection; None where there is none, or it was turned away."""
        try:
            return server.accept()[0]
        except OSError as error:
            # Anybody else has given up already.
            if error.errno in _EXHAUSTED:
                self._turn_away(server)
            return None

    def close(self) -> None:
        """Give back what is kept."""
        if self._spare is not None:
            os.close(self._spare)
            self._spare = None

    def _turn_away(self, server: socket.socket) -> None:
        self.close()
        with suppress(OSError):
            server.accept()[0].close()
        self.open()
