"""Raw bytes over TCP: `tcp:HOST:PORT`."""

from __future__ import annotations

import contextlib
import selectors
import socket
from typing import TYPE_CHECKING

from drivecomm.errors import PortError, reason_of
from drivecomm.virtual.accepting import Accepting

if TYPE_CHECKING:
    from drivecomm.protocol import LineSettings

# Small reads, so that a master which floods the line does not block the server.
_CHUNK = 512

_AHEAD = 16384
# A master that waits for replies never sends this much ahead.
_FLOOD = 4096
_MOST_THROWN_AWAY = 64_000_000


class TcpListener:
    """Raw bytes over TCP for one master at a time; further connections are closed immediately."""

    scheme = "socket"

    def __init__(self, host: str, port: int) -> None:
        self._host = host
        self._port = port
        self._selector: selectors.BaseSelector | None = None
        self._server: socket.socket | None = None
        self._accepting = Accepting()
        self._master: socket.socket | None = None

    @property
    def address(self) -> str:
        """The URL that a master opens."""
        host = f"[{self._host}]" if ":" in self._host else self._host
        return f"{self.scheme}://{host}:{self._port}"

    @property
    def settings(self) -> LineSettings | None:
        """None, because plain TCP carries no line settings."""
        return None

    @property
    def descriptor(self) -> int | None:
        """A descriptor that covers the master's connection and the listening socket; None when closed."""
        if self._selector is None:
            return None
        try:
            # A selector such as epoll has a descriptor of its own.
            return self._selector.fileno()  # type: ignore[attr-defined, no-any-return]
        except AttributeError:
            # On Windows it has none, so the next master waits until the present one has gone.
            watched = self._master or self._server
            return None if watched is None else watched.fileno()

    def open(self) -> None:
        """Listen for connections. Raises PortError."""
        try:
            family = socket.AF_INET6 if ":" in self._host else socket.AF_INET
            self._server = socket.create_server((self._host, self._port), family=family, backlog=5)
        except (OSError, OverflowError) as error:
            raise PortError(
                f"cannot listen at {self._host}:{self._port} ({reason_of(error)}); "
                "choose another port number, or 0 for any free one, and an address of this machine"
            ) from error
        self._server.setblocking(False)
        self._accepting.open()
        # Bytes that a master sends ahead wait on its own side, not here.
        self._server.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _AHEAD)
        self._port = self._server.getsockname()[1]
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._server, selectors.EVENT_READ)

    def receive(self, wait_s: float) -> bytes:
        """Return bytes from the master; accept one if there is none, and refuse others."""
        if self._selector is None:
            return b""
        taken, data = (0, b"") if self._master is None or wait_s else self._take(self._master)
        if 0 < taken < _CHUNK:
            return data
        # No bytes, or so many that new connections would never be noticed.
        ready = [key.fileobj for key, _ in self._selector.select(wait_s)]
        if self._server in ready:
            self._accept_next()
        if not taken and self._master is not None and self._master in ready:
            _, data = self._take(self._master)
        return data

    def _take(self, master: socket.socket) -> tuple[int, bytes]:
        """Return the number of bytes that the master sent, and those for the line; disconnect it if it has gone."""
        try:
            data = master.recv(_CHUNK)
        except BlockingIOError:
            return 0, b""
        except OSError:
            data = b""
        if not data:
            self._disconnect()
            return 0, b""
        return len(data), self._received(data)

    def send(self, data: bytes) -> None:
        """Send bytes to the master; disconnect it if its buffer is full because it does not read."""
        if self._master is None:
            return
        try:
            if self._master.send(data) < len(data):
                self._disconnect()
        except OSError:
            self._disconnect()

    def close(self) -> None:
        """Stop listening, and close the master's connection."""
        self._disconnect()
        if self._selector is not None:
            self._selector.close()
            self._selector = None
        if self._server is not None:
            self._server.close()
            self._server = None
        self._accepting.close()

    def _accept_next(self) -> None:
        """Accept or refuse the next master; do neither while unread bytes hide whether the present one has gone.

        A flood is discarded: at the speed of the line its end would come minutes after the master has gone.
        """
        if self._master is not None:
            ahead = self._sent_ahead(self._master)
            if ahead > _FLOOD:
                ahead = self._throw_away(self._master)
            if ahead > 0:
                return
            if ahead == 0:
                self._disconnect()
        newcomer = None if self._server is None else self._accepting.next(self._server)
        if newcomer is None:
            return
        if self._master is None:
            self._connect(newcomer)
        else:
            newcomer.close()

    def _sent_ahead(self, master: socket.socket) -> int:
        """Return the number of waiting bytes; 0 if the master has gone, -1 if it is connected and silent."""
        try:
            return len(master.recv(_AHEAD, socket.MSG_PEEK))
        except BlockingIOError:
            return -1
        except OSError:
            return 0

    def _throw_away(self, master: socket.socket) -> int:
        """Discard all waiting bytes; return 0 if the master has gone, -1 if it is still connected."""
        left = _MOST_THROWN_AWAY
        try:
            while left > 0 and (taken := len(master.recv(_AHEAD))):
                left -= taken
        except BlockingIOError:
            return -1
        except OSError:
            return 0
        return 0 if left > 0 else -1

    def _prepare(self, client: socket.socket) -> None:
        client.setblocking(False)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        # Otherwise a master that was switched off would block the next ones for ever.
        client.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)

    def _connect(self, master: socket.socket) -> None:
        self._prepare(master)
        if self._selector is not None:
            self._selector.register(master, selectors.EVENT_READ)
        self._master = master
        self._arrived()

    def _disconnect(self) -> None:
        if self._master is None:
            return
        if self._selector is not None:
            self._selector.unregister(self._master)
        with contextlib.suppress(OSError):
            self._master.shutdown(socket.SHUT_WR)
        self._master.close()
        self._master = None

    def _arrived(self) -> None:
        """Called when a master has connected."""

    def _received(self, data: bytes) -> bytes:
        """Return those of the received bytes that are for the line."""
        return data
