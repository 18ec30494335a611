"""The subset of HTTP/1.1 (RFC 9112) that is used on a server's local socket.

The standard library's client also loads TLS and e-mail formats, which takes longer than all requests of a command.
"""

from __future__ import annotations

import select
import socket
from typing import TYPE_CHECKING

from drivecomm.client.peers import check_peer

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivecomm.client.registration import Registration

BAD_REQUEST = 400
"""Lowest status code of an error response."""

_CHUNK = 1 << 16
_LONGEST_LINE = 1 << 16
_MOST_HEADERS = 100
_INFORMATION = range(100, 200)


class HttpStream:
    """Byte stream of one connection, split into lines and pieces. Raises OSError, ValueError for malformed HTTP."""

    def __init__(self, connected: socket.socket) -> None:
        self._socket = connected
        self._pending = b""

    def head(self) -> tuple[str, dict[str, str]]:
        """Return the first line of a request or a response, and its headers, in lower case."""
        first, headers = self.line(), {}
        while text := self.line():
            name, _, value = text.partition(":")
            headers[name.lower()] = value.strip().lower()
            if len(headers) > _MOST_HEADERS:
                raise ValueError("headers without an end")
        return first, headers

    def line(self) -> str:
        """Return the next line."""
        while b"\r\n" not in self._pending:
            if len(self._pending) > _LONGEST_LINE:
                raise ValueError("a line without an end")
            self._receive()
        line, _, self._pending = self._pending.partition(b"\r\n")
        return line.decode("latin-1")

    def exactly(self, number: int) -> bytes:
        """Return the next N bytes."""
        while len(self._pending) < number:
            self._receive()
        data, self._pending = self._pending[:number], self._pending[number:]
        return data

    def some(self) -> bytes:
        """Return the next available bytes, empty at the end of the connection."""
        if not self._pending:
            return self._socket.recv(_CHUNK)
        data, self._pending = self._pending, b""
        return data

    def close(self) -> None:
        """Close the connection."""
        self._socket.close()

    def _receive(self) -> None:
        data = self._socket.recv(_CHUNK)
        if not data:
            raise ConnectionResetError("the connection breaks off")
        self._pending += data


class LocalConnection(HttpStream):
    """Connection to a server. Raises OSError, ValueError for malformed HTTP. limit_s: time limit of each step.

    Raises PermissionError if a program of another user listens there, because its statements about motors are not
    trusted.
    """

    def __init__(self, server: Registration, limit_s: float) -> None:
        self._host = "localhost" if server.socket else f"127.0.0.1:{server.port}"
        self._token = server.token
        if not server.socket:
            super().__init__(socket.create_connection(("127.0.0.1", server.port), timeout=limit_s))
            return
        super().__init__(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM))
        try:
            self._socket.settimeout(limit_s)
            self._socket.connect(server.socket)
            check_peer(self._socket, server.socket)
        except OSError:
            self._socket.close()
            raise

    def request(self, method: str, path: str, body: bytes | None = None) -> None:
        """Send a request, with a JSON body if there is one."""
        lines = [f"{method} {path} HTTP/1.1", f"Host: {self._host}", "Accept: application/json"]
        if self._token:
            lines.append(f"Authorization: Bearer {self._token}")
        if body is not None:
            lines += ["Content-Type: application/json", f"Content-Length: {len(body)}"]
        self._socket.sendall("\r\n".join([*lines, "", ""]).encode("ascii") + (body or b""))

    def has_more(self, seconds: float) -> bool:
        """Return whether bytes, or the end of the connection, arrive within this time."""
        return bool(self._pending) or bool(select.select([self._socket], [], [], seconds)[0])

    def answer(self) -> LocalAnswer:
        """Read the head of the response, and return the response, whose content is read separately."""
        while True:
            first, headers = self.head()
            version, _, rest = first.partition(" ")
            if not version.startswith("HTTP/1."):
                raise ValueError("a response that is not HTTP")
            status = int(rest.partition(" ")[0])
            if status not in _INFORMATION:
                return LocalAnswer(self, status, headers)


class LocalAnswer:
    """HTTP response. status: its status code. stays_open: whether the connection may be used again."""

    def __init__(self, connection: LocalConnection, status: int, headers: dict[str, str]) -> None:
        self._connection = connection
        self.status = status
        self._chunked = headers.get("transfer-encoding", "") == "chunked"
        self._length = int(headers["content-length"]) if "content-length" in headers else None
        framed = self._chunked or self._length is not None
        self.stays_open = framed and headers.get("connection") != "close"

    def pieces(self) -> Iterator[bytes]:
        """Yield the content as it arrives; blocks for the next piece, so check `LocalConnection.has_more` first."""
        if self._chunked:
            while size := int(self._connection.line().partition(";")[0], 16):
                data = self._connection.exactly(size + 2)
                yield data[:size]
            # Trailer fields may follow the last piece.
            while self._connection.line():
                pass
        elif self._length is not None:
            yield self._connection.exactly(self._length)
        else:
            while data := self._connection.some():
                yield data
