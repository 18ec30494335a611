"""Connecting to a serial server, and noticing that it serves somebody else.

Most of them serve one client at a time, and close the connection of a second one at once, some with a word about it.
"""

from __future__ import annotations

import socket
import time
from urllib.parse import urlsplit

from drivecomm.transport.opening import HungUpError, cannot_open
from drivecomm.transport.readiness import Readable

_CONNECT_S = 5.0
# The end of a connection takes as long as its beginning, and the server some time to decide on it.
_DECIDING_S = 0.03
_CHUNK = 4096

_monotonic = time.monotonic


def connected(url: str) -> tuple[socket.socket, bytes]:
    """Return the connection to `socket://HOST:PORT`, which does not block, and what has come from it by now.

    Raises PortError, also when the server serves somebody else and says so by closing the connection.
    """
    try:
        parts = urlsplit(url)
        began = _monotonic()
        # Without a port number this is port 0, where nobody ever listens.
        connection = socket.create_connection((parts.hostname or "", parts.port or 0), timeout=_CONNECT_S)
        try:
            connection.setblocking(False)
            # Of a server that was switched off nothing would ever be heard otherwise.
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            now = _monotonic()
            return connection, _first_bytes(connection, now + (now - began) + _DECIDING_S)
        except BaseException:
            connection.close()
            raise
    except (OSError, ValueError) as error:
        raise cannot_open(url, error) from error


def _first_bytes(connection: socket.socket, until: float) -> bytes:
    readable = Readable(connection.fileno())
    data = b""
    while readable.wait(until):
        piece = connection.recv(_CHUNK)
        if not piece:
            raise HungUpError(data)
        data += piece
        if _monotonic() >= until:
            break
    return data
