"""Bytes over TCP: `socket://HOST:PORT`, and `modbus-tcp://HOST`, where the protocol package does the framing."""

from __future__ import annotations

import contextlib
import errno
import socket
import time
from typing import TYPE_CHECKING

from drivecomm.transport.channel import ChannelGoneError
from drivecomm.transport.opening import HungUpError, cannot_open
from drivecomm.transport.port_names import tcp_place
from drivecomm.transport.readiness import Readable, send_all

if TYPE_CHECKING:
    from drivecomm.protocol import LineSettings

_CHUNK = 4096
# Far below the size of any receive buffer, and above the length of a reply.
_LONGEST_HOLD = 255

_monotonic = time.monotonic


class SocketChannel:
    """Connection to a serial server. pyserial's own waits 0.3 s at each close and delays short telegrams."""

    paced = False

    def __init__(self, url: str) -> None:
        # Bytes from before the first request are no reply and are dropped.
        self._socket, _ = connect_to_serial_server(url)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.descriptor: int = self._socket.fileno()
        self._readable = Readable(self.descriptor)
        self._held = 1

    def apply(self, settings: LineSettings) -> str:
        """Change no settings, because the server has its own; return a note that says so."""
        return f"raw TCP: {settings} is not carried, the server has its own line settings"

    def send(self, data: bytes, limit_s: float) -> None:
        """Pass on all bytes within limit_s seconds."""
        try:
            self._look_for_the_end()
            if send_all(self._socket.send, self.descriptor, data, limit_s):
                return
        except OSError as error:
            raise _broke(error) from error
        raise ChannelGoneError(f"it accepted no bytes for {limit_s:.0f} s")

    def receive(self, until: float, wanted: int) -> bytes:
        """Return the received bytes once there are `wanted` bytes, or at `until` whatever has arrived."""
        if until <= _monotonic():
            return self.take()
        data = b""
        while True:
            self.hold_back(wanted - len(data))
            if not self._readable.wait(until):
                return data + self.take()
            data += self.take()
            if len(data) >= wanted:
                return data

    def take(self) -> bytes:
        """Return the received bytes."""
        try:
            data = self._socket.recv(_CHUNK)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise _broke(error) from error
        if not data:
            raise ChannelGoneError("the server closed the connection")
        return data

    def hold_back(self, at_least: int) -> None:
        """Make the descriptor readable only for this many bytes; not every system can."""
        at_least = max(1, min(at_least, _LONGEST_HOLD))
        if at_least == self._held:
            return
        self._held = at_least
        with contextlib.suppress(OSError):
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVLOWAT, at_least)

    def close(self) -> None:
        """Close the connection; bytes already sent still arrive."""
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_WR)
            # Closing with unread bytes would reset the connection and lose the last bytes sent.
            while self._socket.recv(_CHUNK):
                pass
        self._socket.close()

    def _look_for_the_end(self) -> None:
        """Raise BrokenPipeError if the server has closed the connection: it would discard further bytes."""
        with contextlib.suppress(BlockingIOError):
            if not self._socket.recv(1, socket.MSG_PEEK):
                raise BrokenPipeError(errno.EPIPE, "the server closed it")


def _broke(error: OSError) -> ChannelGoneError:
    return ChannelGoneError(f"the connection broke: {error.strerror or error}")


_CONNECT_S = 5.0
# A refusal takes as long to arrive as the connection took, plus the time the server needs to decide.
_DECIDING_S = 0.03


def connect_to_serial_server(url: str) -> tuple[socket.socket, bytes]:
    """Return a non-blocking connection to `socket://HOST:PORT` or its like, and the bytes received so far.

    Raises PortError, also if the server serves another client and therefore closes the connection.
    """
    try:
        place = tcp_place(url)
        began = _monotonic()
        connection = socket.create_connection(place, timeout=_CONNECT_S)
        try:
            connection.setblocking(False)
            # Otherwise a server that is switched off would never be noticed.
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
