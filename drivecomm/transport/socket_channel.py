"""Raw bytes over TCP: `socket://HOST:PORT`."""

from __future__ import annotations

import contextlib
import socket
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from drivecomm.transport.channel import ChannelGoneError
from drivecomm.transport.opening import cannot_open

if TYPE_CHECKING:
    from drivecomm.line import LineSettings

_CONNECT_S = 5.0
_CHUNK = 4096


class SocketChannel:
    """A connection to a serial server. pyserial's own waits 0.3 s at each close and delays short telegrams."""

    paced = False

    def __init__(self, url: str) -> None:
        try:
            parts = urlsplit(url)
            # Without a port number this is port 0, where nobody ever listens.
            self._socket = socket.create_connection((parts.hostname or "", parts.port or 0), timeout=_CONNECT_S)
        except (OSError, ValueError) as error:
            raise cannot_open(url, error) from error
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        # Of a server that was switched off nothing would ever be heard otherwise.
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)

    def apply(self, settings: LineSettings) -> str:
        """Change nothing: the far end has its own settings."""
        return f"raw TCP: {settings} is not carried, the server has its own line settings"

    def send(self, data: bytes, limit_s: float) -> None:
        """Hand over all bytes within this time."""
        try:
            self._socket.settimeout(limit_s)
            self._socket.sendall(data)
        except TimeoutError as error:
            raise ChannelGoneError(f"it took no bytes for {limit_s:.0f} s") from error
        except OSError as error:
            raise ChannelGoneError(f"the connection broke: {error.strerror or error}") from error

    def receive(self, wait_s: float, wanted: int) -> bytes:  # noqa: ARG002 - a socket wakes for any byte
        """Return what is there, or comes first within this time."""
        try:
            self._socket.settimeout(wait_s)
            data = self._socket.recv(_CHUNK)
        except (TimeoutError, BlockingIOError):
            return b""
        except OSError as error:
            raise ChannelGoneError(f"the connection broke: {error.strerror or error}") from error
        if not data:
            raise ChannelGoneError("the server closed the connection")
        return data

    def close(self) -> None:
        """Close the connection; what was sent still arrives."""
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_WR)
            # Closing with unread bytes would reset the connection, and what was sent last would be lost with it.
            self._socket.settimeout(0)
            while self._socket.recv(_CHUNK):
                pass
        self._socket.close()
