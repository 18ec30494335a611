"""A connected socket that is read in large pieces, for a library that asks for single bytes.

Each call of the system lets another thread go first, which costs more than the call.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import socket

_AT_ONCE = 16384
"""As much as a record of TLS holds, so that none of it stays behind where nobody is told of it."""


class BufferedSocket:
    """A socket that does not block. Everything but `recv` and `pending` is the socket's own."""

    def __init__(self, its: socket.socket) -> None:
        self._its = its
        self._read = b""
        self._is_over = False

    def recv(self, size: int) -> bytes:
        """Return up to so many bytes. Raises BlockingIOError after each piece: a flood leaves others their turn."""
        if not self._read:
            if self._is_over:
                self._is_over = False
                raise BlockingIOError
            self._read = self._its.recv(max(size, _AT_ONCE))
            self._is_over = bool(self._read)
        taken, self._read = self._read[:size], self._read[size:]
        return taken

    def pending(self) -> int:
        """Return how many bytes can be had of which the system does not tell."""
        of_tls = getattr(self._its, "pending", None)
        return len(self._read) + (0 if of_tls is None else of_tls())

    def __getattr__(self, name: str) -> Any:
        return getattr(self._its, name)
