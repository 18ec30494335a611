"""Raw bytes over TCP: `tcp:HOST:PORT`."""

from __future__ import annotations

import contextlib
import selectors
import socket
from typing import TYPE_CHECKING

from drivecomm.errors import PortError

if TYPE_CHECKING:
    from drivecomm.line import LineSettings

# A little at a time, so that a master who floods the line cannot keep the server from anything else.
_CHUNK = 512

_AHEAD = 16384


class TcpListener:
    """Raw bytes over TCP, for one master after the other: the next one waits until the present one has gone."""

    scheme = "socket"

    def __init__(self, host: str, port: int) -> None:
        self._host = host
        self._port = port
        self._selector: selectors.BaseSelector | None = None
        self._door: socket.socket | None = None
        self._master: socket.socket | None = None

    @property
    def address(self) -> str:
        """The URL to open."""
        host = f"[{self._host}]" if ":" in self._host else self._host
        return f"{self.scheme}://{host}:{self._port}"

    @property
    def settings(self) -> LineSettings | None:
        """None: plain TCP carries no line settings."""
        return None

    @property
    def descriptor(self) -> int | None:
        """The master's connection; the door while there is none."""
        watched = self._master or self._door
        return None if watched is None else watched.fileno()

    def open(self) -> None:
        """Listen. Raises PortError."""
        try:
            family = socket.AF_INET6 if ":" in self._host else socket.AF_INET
            self._door = socket.create_server((self._host, self._port), family=family, backlog=5)
        except (OSError, OverflowError) as error:
            raise PortError(
                f"cannot listen at {self._host}:{self._port} ({getattr(error, 'strerror', None) or error}); "
                "choose another port number, or 0 for any free one, and a host address of this machine"
            ) from error
        self._door.setblocking(False)
        # What a master sends ahead waits on its own side, not here.
        self._door.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _AHEAD)
        self._port = self._door.getsockname()[1]
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._door, selectors.EVENT_READ)

    def receive(self, wait_s: float) -> bytes:
        """Return what the master sent; let one in if there is none."""
        if self._selector is None or not self._selector.select(wait_s):
            return b""
        if self._master is None:
            self._let_in()
            return b""
        try:
            data = self._master.recv(_CHUNK)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self._let_go()
            return b""
        return self._received(data)

    def send(self, data: bytes) -> None:
        """Send to the master; one that has not read for so long that nothing fits any more is let go."""
        if self._master is None:
            return
        try:
            if self._master.send(data) < len(data):
                self._let_go()
        except OSError:
            self._let_go()

    def close(self) -> None:
        """Stop listening; end the master's connection."""
        self._let_go()
        if self._selector is not None:
            self._selector.close()
            self._selector = None
        if self._door is not None:
            self._door.close()
            self._door = None

    def _let_in(self) -> None:
        if self._door is None or self._selector is None:
            return
        try:
            master, _ = self._door.accept()
        except OSError:
            # It has given up already.
            return
        master.setblocking(False)
        master.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        # A master that was switched off would keep the next ones out for ever otherwise.
        master.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        self._selector.unregister(self._door)
        self._selector.register(master, selectors.EVENT_READ)
        self._master = master
        self._arrived()

    def _let_go(self) -> None:
        if self._master is None:
            return
        if self._selector is not None and self._door is not None:
            self._selector.unregister(self._master)
            self._selector.register(self._door, selectors.EVENT_READ)
        with contextlib.suppress(OSError):
            self._master.shutdown(socket.SHUT_WR)
        self._master.close()
        self._master = None

    def _arrived(self) -> None:
        """A master has come."""

    def _received(self, data: bytes) -> bytes:
        """Return what of the bytes that came is for the line."""
        return data
