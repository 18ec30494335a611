"""A connected socket that is read and written in large pieces, for a library that asks for single bytes.

Each call of the system lets another thread go first, which costs more than the call.
"""

from __future__ import annotations

import socket
import ssl
from typing import Any

_QUICK_ACK = getattr(socket, "TCP_QUICKACK", None)
_AT_ONCE = 16384
"""As much as a record of TLS holds, so that none of it stays behind where nobody is told of it."""


class BufferedSocket:
    """A socket that does not block. What is not here is the socket's own."""

    def __init__(self, its: socket.socket) -> None:
        self._its = its
        self._read = b""
        self._is_over = False
        self._unsent = bytearray()

    def recv(self, size: int) -> bytes:
        """Return up to so many bytes. Raises BlockingIOError after each piece: a flood leaves others their turn."""
        if not self._read:
            if self._is_over:
                self._is_over = False
                raise BlockingIOError
            self._read = self._its.recv(max(size, _AT_ONCE))
            if _QUICK_ACK is not None:
                # Brokers send their next small packet when this one is acknowledged, for which the system takes 40 ms.
                self._its.setsockopt(socket.IPPROTO_TCP, _QUICK_ACK, 1)
            self._is_over = bool(self._read)
        taken, self._read = self._read[:size], self._read[size:]
        return taken

    def pending(self) -> int:
        """Return how many bytes can be had of which the system does not tell."""
        of_tls = getattr(self._its, "pending", None)
        return len(self._read) + (0 if of_tls is None else of_tls())

    def send(self, data: bytes | bytearray) -> int:
        """Keep all of it for `flush`; return how much that is."""
        self._unsent += data
        return len(data)

    def flush(self) -> bool:
        """Send what is kept; return whether all of it has gone, or nobody takes it any more, as reading tells then."""
        if not self._unsent:
            return True
        try:
            del self._unsent[: self._its.send(self._unsent)]
        except (BlockingIOError, ssl.SSLWantReadError, ssl.SSLWantWriteError):
            return False
        except OSError:
            self._unsent.clear()
        return not self._unsent

    def close(self) -> None:
        """Send what is kept, as far as that can be done at once, and close the socket."""
        self.flush()
        self._its.close()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._its, name)
