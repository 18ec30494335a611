"""Raw bytes over TCP for one master and up to 32 read-only clients that hear the whole line."""

from __future__ import annotations

import contextlib
import selectors
from typing import TYPE_CHECKING

from drivecomm.virtual.tcp_listener import TcpListener

if TYPE_CHECKING:
    import socket

_CHUNK = 512
_MOST_LISTENERS = 32


class SharedTcpListener(TcpListener):
    """A TCP listener with read-only clients; the first client that sends while there is no master becomes the master.

    A client receives everything on the line, from master and drives alike, once its last character has been sent. Bytes
    from clients are discarded while there is a master, and a client that does not read is disconnected.
    """

    def __init__(self, host: str, port: int) -> None:
        super().__init__(host, port)
        self._listeners: list[socket.socket] = []

    def overhear(self, data: bytes) -> None:
        """Send bytes from the line to all read-only clients; never blocks."""
        for each in tuple(self._listeners):
            try:
                is_taken = each.send(data) == len(data)
            except OSError:
                is_taken = False
            if not is_taken:
                self._drop(each)

    def receive(self, wait_s: float) -> bytes:
        """Return bytes from the master; accept clients, and make a sending one the master if there is none."""
        # Accept first, so that a connected client hears everything that is sent from then on.
        self._accept_next()
        data = super().receive(wait_s)
        if self._selector is None:
            return data
        for key, _ in self._selector.select(0):
            if key.fileobj in self._listeners:
                data += self._heard_from(key.fileobj, is_wanted=not data)
        return data

    def close(self) -> None:
        """Stop listening, and close all connections."""
        for each in tuple(self._listeners):
            self._drop(each)
        super().close()

    def _accept_next(self) -> None:
        for _ in range(_MOST_LISTENERS):
            newcomer = None if self._server is None else self._accepting.next(self._server)
            if newcomer is None:
                return
            if len(self._listeners) >= _MOST_LISTENERS or self._selector is None:
                newcomer.close()
                continue
            self._prepare(newcomer)
            self._selector.register(newcomer, selectors.EVENT_READ)
            self._listeners.append(newcomer)

    def _heard_from(self, listener: socket.socket, *, is_wanted: bool) -> bytes:
        try:
            data = listener.recv(_CHUNK)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self._drop(listener)
            return b""
        if self._master is not None or not is_wanted:
            return b""
        self._listeners.remove(listener)
        self._master = listener
        self._arrived()
        return self._received(data)

    def _drop(self, listener: socket.socket) -> None:
        self._listeners.remove(listener)
        if self._selector is not None:
            with contextlib.suppress(KeyError):
                self._selector.unregister(listener)
        listener.close()
