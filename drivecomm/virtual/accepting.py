"""Accepting connections without a busy loop when the process has run out of file descriptors."""

from __future__ import annotations

import errno
import os
from contextlib import suppress
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import socket

_EXHAUSTED = (errno.EMFILE, errno.ENFILE)


class Accepting:
    """Acceptor of connections; without a free descriptor, it closes new ones by means of a reserved descriptor.

    Otherwise the listening socket would stay readable, and a select on it would never block again.
    """

    def __init__(self) -> None:
        self._spare: int | None = None

    def open(self) -> None:
        """Reserve a descriptor, if one is free."""
        with suppress(OSError):
            self._spare = os.open(os.devnull, os.O_RDONLY)

    def next(self, server: socket.socket) -> socket.socket | None:
        """Return the next connection; None if there is none, or if it was closed for lack of descriptors."""
        try:
            return server.accept()[0]
        except OSError as error:
            # Any other error means that the client has already given up.
            if error.errno in _EXHAUSTED:
                self._turn_away(server)
            return None

    def close(self) -> None:
        """Release the reserved descriptor."""
        if self._spare is not None:
            os.close(self._spare)
            self._spare = None

    def _turn_away(self, server: socket.socket) -> None:
        self.close()
        with suppress(OSError):
            server.accept()[0].close()
        self.open()
