"""A connected socket that reads and writes in large pieces, for a library that reads single bytes.

Each system call lets another thread go first, which costs more than the call itself.
"""

from __future__ import annotations

import socket
import ssl
from typing import Any

_QUICK_ACK = getattr(socket, "TCP_QUICKACK", None)
_AT_ONCE = 16384
"""The size of a TLS record: a smaller read leaves bytes in the TLS layer that the socket does not report."""


class BufferedSocket:
    """A non-blocking socket with buffers. Other attributes are those of the socket itself."""

    def __init__(self, its: socket.socket) -> None:
        self._its = its
        self._read = b""
        self._is_over = False
        self._unsent = bytearray()

    def recv(self, size: int) -> bytes:
        """Return up to `size` bytes.

        Raises BlockingIOError after each piece, so that other tasks get their turn during a flood.
        """
        if not self._read:
            if self._is_over:
                self._is_over = False
                raise BlockingIOError
            self._read = self._its.recv(max(size, _AT_ONCE))
            if _QUICK_ACK is not None:
                # Brokers wait for this acknowledgement before the next small packet, and the system delays it by 40 ms.
                self._its.setsockopt(socket.IPPROTO_TCP, _QUICK_ACK, 1)
            self._is_over = bool(self._read)
        taken, self._read = self._read[:size], self._read[size:]
        return taken

    def pending(self) -> int:
        """Return the number of received bytes that the system no longer reports as readable."""
        of_tls = getattr(self._its, "pending", None)
        return len(self._read) + (0 if of_tls is None else of_tls())

    def send(self, data: bytes | bytearray) -> int:
        """Buffer all bytes until `flush`; return their number."""
        self._unsent += data
        return len(data)

    def flush(self) -> bool:
        """Send buffered bytes; return whether none are left.

        After an error the bytes are dropped, and the next read raises the error.
        """
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
        """Send buffered bytes as far as possible without waiting, and close the socket."""
        self.flush()
        self._its.close()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._its, name)
