"""Requests to a server of this machine, over its local socket: JSON by HTTP, answers and streams.

A server that goes, or that says nothing any more, is a ServerLostError; nothing waits for ever. A command is sent once,
over a connection of its own: one that was kept open may have been closed meanwhile, and then nobody would know.
"""

from __future__ import annotations

import http.client
import select
import socket
import time
from collections import deque
from contextlib import closing, contextmanager
from typing import TYPE_CHECKING, Any

from drivecomm.client.wire import error_of, json_text, parsed, plain
from drivecomm.errors import DriveCommError, ServerLostError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from drivecomm.client.registration import Registration

ALIVE_S = 2.0
"""A server that is well says so within this time, whatever else it has to do."""

LONGEST_S = 60.0
"""No answer takes longer than this, unless it is said."""

_STREAM_TICK_S = 0.1
_CHUNK = 1 << 16
_ERRORS = (OSError, ValueError, http.client.HTTPException)


class LocalServer:
    """The way to a server that runs. May be used by many threads: a stop does not wait for what others have asked.

    alive_s: how long the server may take to say that it is there at all.
    """

    def __init__(self, registration: Registration, *, alive_s: float = ALIVE_S) -> None:
        self.registration = registration
        self._alive_s = alive_s
        self._idle: deque[_Connection] = deque()

    def ask(self, path: str, *, limit_s: float = LONGEST_S) -> Any:
        """Return what is at a path. Raises the error that the server answers, ServerLostError where it does not."""
        return self._repeatable("GET", path, None, limit_s)

    def read(self, path: str, content: Mapping[str, Any], *, limit_s: float = LONGEST_S) -> Any:
        """Post what commands nothing, so that it may be sent again when the connection was lost."""
        return self._repeatable("POST", path, content, limit_s)

    def order(self, path: str, content: Mapping[str, Any], *, method: str = "POST", limit_s: float = LONGEST_S) -> Any:
        """Send what must not be done twice, and return what came of it."""
        with self._errors(), closing(self._connected()) as connection:
            return self._answer(connection, method, path, content, limit_s)

    @contextmanager
    def stream(self, path: str, content: Mapping[str, Any] | None = None) -> Iterator[Iterator[Any]]:
        """Yield the objects of a stream, one a line, as they come; it has begun when the block is entered.

        None is among them now and then while nothing comes, so that whoever reads can see whether to go on.
        """
        with self._errors():
            connection = self._connected()
        # http.client lets go of it where the server says that nothing follows the stream.
        sock = connection.sock
        with closing(sock), closing(connection):
            with self._errors():
                response = self._response(connection, "GET" if content is None else "POST", path, content, LONGEST_S)
                if response.status >= http.client.BAD_REQUEST:
                    raise _refusal(response.read())
            with closing(response):
                yield self._lines(sock, response)

    def close(self) -> None:
        """End the connections that are kept open."""
        while self._idle:
            self._idle.pop().close()

    def is_alive(self) -> bool:
        """Whether the server answers at all."""
        try:
            with closing(_Connection(self.registration, self._alive_s)) as connection:
                connection.request("GET", "/healthz")
                connection.getresponse().read()
        except _ERRORS:
            return False
        return True

    def _repeatable(self, method: str, path: str, content: Mapping[str, Any] | None, limit_s: float) -> Any:
        with self._errors():
            if (connection := self._from_idle()) is not None:
                try:
                    return self._kept(connection, method, path, content, limit_s)
                except (ConnectionError, http.client.HTTPException):
                    # It was closed meanwhile, as the server may at any time.
                    pass
            return self._kept(self._connected(), method, path, content, limit_s)

    def _from_idle(self) -> _Connection | None:
        try:
            return self._idle.pop()
        except IndexError:
            return None

    def _kept(
        self, connection: _Connection, method: str, path: str, content: Mapping[str, Any] | None, limit_s: float
    ) -> Any:
        try:
            answer = self._answer(connection, method, path, content, limit_s)
        except BaseException as error:
            # What the server has refused leaves the connection as it was.
            if isinstance(error, DriveCommError):
                self._idle.append(connection)
            else:
                connection.close()
            raise
        self._idle.append(connection)
        return answer

    def _answer(
        self, connection: _Connection, method: str, path: str, content: Mapping[str, Any] | None, limit_s: float
    ) -> Any:
        response = self._response(connection, method, path, content, limit_s)
        data = response.read()
        if response.status >= http.client.BAD_REQUEST:
            raise _refusal(data)
        try:
            return parsed(data) if data else None
        except ValueError as error:
            raise http.client.HTTPException("an answer that is no JSON") from error

    def _response(
        self, connection: _Connection, method: str, path: str, content: Mapping[str, Any] | None, limit_s: float
    ) -> http.client.HTTPResponse:
        """Send a request, and wait for its answer for as long as the server lives, limit_s at most."""
        body = None if content is None else json_text(plain(content)).encode()
        headers = {} if body is None else {"Content-Type": "application/json"}
        if self.registration.token:
            headers["Authorization"] = f"Bearer {self.registration.token}"
        connection.request(method, path, body, headers)
        until = time.monotonic() + limit_s
        while not connection.has_answer(min(self._alive_s, max(0.0, until - time.monotonic()))):
            if time.monotonic() >= until:
                raise TimeoutError(f"no answer within {limit_s:g} s")
            if not self.is_alive():
                raise TimeoutError(f"no answer within {self._alive_s:g} s")
        return connection.getresponse()

    def _lines(self, sock: socket.socket, response: http.client.HTTPResponse) -> Iterator[Any]:
        # What http.client makes of chunks waits for the next one before it hands over what has come.
        chunks = _Chunks(response.chunked)
        pending = b""
        heard_at = time.monotonic()
        with self._errors():
            while True:
                if not _has_more(sock, response):
                    if time.monotonic() - heard_at > self._alive_s:
                        if not self.is_alive():
                            raise TimeoutError(f"no answer within {self._alive_s:g} s")
                        heard_at = time.monotonic()
                    yield None
                    continue
                heard_at = time.monotonic()
                piece = response.fp.read1(_CHUNK)
                *lines, pending = (pending + chunks.taken(piece)).split(b"\n")
                yield from (parsed(line) for line in lines if line.strip())
                if chunks.ended or (not piece and not response.chunked):
                    return
                if not piece:
                    raise ConnectionResetError("a stream that breaks off")

    def _connected(self) -> _Connection:
        connection = _Connection(self.registration, self._alive_s)
        connection.connect()
        return connection

    @contextmanager
    def _errors(self) -> Iterator[None]:
        """Let what goes wrong on the way be a ServerLostError."""
        try:
            yield
        except _ERRORS as error:
            if isinstance(error, DriveCommError):
                raise
            raise self._lost(error) from error

    def _lost(self, error: Exception) -> ServerLostError:
        which = self.registration
        if isinstance(error, TimeoutError | BlockingIOError):
            return ServerLostError(
                f"the server of {which.plant} (pid {which.pid}) does not answer ({error}); end it and start it again, "
                "and look at the motors: what was asked of it may have been done"
            )
        return ServerLostError(
            f"the server of {which.plant} (pid {which.pid}) has gone; start it again with drivecomm serve "
            f"{which.plant}, and look at the motors: what was asked of it may have been done"
        )


class _Connection(http.client.HTTPConnection):
    """HTTP over the server's local socket, or over TCP on this machine where it has none."""

    def __init__(self, registration: Registration, limit_s: float) -> None:
        super().__init__("localhost" if registration.socket else "127.0.0.1", registration.port or None)
        self._limit_s = limit_s
        self._file = registration.socket

    def connect(self) -> None:
        """Connect. Raises OSError."""
        if self._file:
            sock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            sock.settimeout(self._limit_s)
            try:
                sock.connect(self._file)
            except OSError:
                sock.close()
                raise
        else:
            sock = socket.create_connection((self.host, self.port), timeout=self._limit_s)
        self.sock = sock

    def has_answer(self, seconds: float) -> bool:
        """Whether something has come within this time, which may be that the server has gone."""
        ready, _, _ = select.select([self.sock], [], [], seconds)
        return bool(ready)


class _Chunks:
    """The pieces in which a stream comes (RFC 9112, section 7.1). ended: the last one has come."""

    def __init__(self, chunked: bool) -> None:
        self._chunked = chunked
        self._pending = b""
        self.ended = False

    def taken(self, data: bytes) -> bytes:
        """Return what these bytes complete."""
        if not self._chunked:
            return data
        self._pending += data
        taken = b""
        while not self.ended:
            head, end, rest = self._pending.partition(b"\r\n")
            size = int(head.partition(b";")[0], 16) if end else 0
            if not end or len(rest) < size + 2:
                break
            taken, self._pending = taken + rest[:size], rest[size + 2 :]
            self.ended = not size
        return taken


def _has_more(sock: socket.socket, response: http.client.HTTPResponse) -> bool:
    """Whether there is something to read of a stream, or its end, within a tick."""
    limit_s = sock.gettimeout()
    sock.settimeout(0.0)
    try:
        # What has come already may wait in the response's own buffer.
        if response.fp.peek(1):
            return True
    finally:
        sock.settimeout(limit_s)
    return bool(select.select([sock], [], [], _STREAM_TICK_S)[0])


def _refusal(data: bytes) -> DriveCommError | http.client.HTTPException:
    """Return the error that the server answers with."""
    try:
        content = parsed(data)["error"]
    except (ValueError, KeyError, TypeError):
        return http.client.HTTPException("an answer that is no JSON")
    return error_of(content)
