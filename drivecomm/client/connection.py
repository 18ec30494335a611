"""Requests to a server of this machine over its local socket: JSON over HTTP, single responses and streams.

A server that ends or stops responding raises ServerLostError, so no request waits forever. A command is sent once, over
a new connection: an idle connection may have been closed meanwhile, and then it would be unknown whether the command
arrived.
"""

from __future__ import annotations

import time
from collections import deque
from contextlib import closing, contextmanager
from typing import TYPE_CHECKING, Any

from drivecomm.client.local_http import BAD_REQUEST, LocalAnswer, LocalConnection
from drivecomm.client.wire import error_of, json_text, parsed, plain
from drivecomm.errors import DriveCommError, ServerLostError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from drivecomm.client.registration import Registration

ALIVE_S = 2.0
"""Time limit in seconds within which a healthy server answers a health request, even under load."""

LONGEST_S = 60.0
"""Default limit of the response time in seconds."""

_STREAM_TICK_S = 0.1
_ERRORS = (OSError, ValueError)


class LocalServer:
    """Connection to a running server, safe for use from many threads: a stop never waits for requests of other threads.

    alive_s: time limit of a health request in seconds.
    """

    def __init__(self, registration: Registration, *, alive_s: float = ALIVE_S) -> None:
        self.registration = registration
        self._alive_s = alive_s
        self._idle: deque[LocalConnection] = deque()

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.registration}>"

    def ask(self, path: str, *, limit_s: float = LONGEST_S) -> Any:
        """Get the content of a path. Raises the server's error, ServerLostError if the server does not respond."""
        return self._repeatable("GET", path, None, limit_s)

    def read(self, path: str, content: Mapping[str, Any], *, limit_s: float = LONGEST_S) -> Any:
        """Post a request that commands nothing, so that it may be sent again after a lost connection."""
        return self._repeatable("POST", path, content, limit_s)

    def order(self, path: str, content: Mapping[str, Any], *, method: str = "POST", limit_s: float = LONGEST_S) -> Any:
        """Send a request that must not be repeated, and return its result."""
        with self._errors(), closing(self._connected()) as connection:
            answer = self._answer(connection, method, path, content, limit_s)
            return _result(answer, b"".join(answer.pieces()))

    @contextmanager
    def stream(self, path: str, content: Mapping[str, Any] | None = None) -> Iterator[Iterator[Any]]:
        """Yield an iterator over the objects of a stream, one per line; the stream has begun when the block is entered.

        The iterator yields None now and then while nothing arrives, so that the reader can decide to stop.
        """
        with self._errors():
            connection = self._connected()
        with closing(connection):
            with self._errors():
                answer = self._answer(connection, "GET" if content is None else "POST", path, content, LONGEST_S)
                if answer.status >= BAD_REQUEST:
                    raise _refusal(parsed(b"".join(answer.pieces())))
            yield self._lines(connection, answer)

    def close(self) -> None:
        """Close the idle connections."""
        while self._idle:
            self._idle.pop().close()

    def is_alive(self) -> bool:
        """Return whether the server responds at all."""
        try:
            with closing(self._connected()) as connection:
                connection.request("GET", "/healthz")
                connection.answer()
        except _ERRORS:
            return False
        return True

    def _repeatable(self, method: str, path: str, content: Mapping[str, Any] | None, limit_s: float) -> Any:
        with self._errors():
            if (connection := self._from_idle()) is not None:
                try:
                    return self._kept(connection, method, path, content, limit_s)
                except ConnectionError:
                    # The server may close an idle connection at any time.
                    pass
            return self._kept(self._connected(), method, path, content, limit_s)

    def _from_idle(self) -> LocalConnection | None:
        try:
            return self._idle.pop()
        except IndexError:
            return None

    def _kept(
        self, connection: LocalConnection, method: str, path: str, content: Mapping[str, Any] | None, limit_s: float
    ) -> Any:
        """Return the result of a request, and keep the connection for the next request."""
        keeps = False
        try:
            answer = self._answer(connection, method, path, content, limit_s)
            data = b"".join(answer.pieces())
            keeps = answer.stays_open
        finally:
            if keeps:
                self._idle.append(connection)
            else:
                connection.close()
        return _result(answer, data)

    def _answer(
        self, connection: LocalConnection, method: str, path: str, content: Mapping[str, Any] | None, limit_s: float
    ) -> LocalAnswer:
        """Send a request, and wait for its response while the server is alive, limit_s seconds at most."""
        connection.request(method, path, None if content is None else json_text(plain(content)).encode())
        until = time.monotonic() + limit_s
        while not connection.has_more(min(self._alive_s, max(0.0, until - time.monotonic()))):
            if time.monotonic() >= until:
                raise TimeoutError(f"no answer within {limit_s:g} s")
            self._check_alive()
        return connection.answer()

    def _lines(self, connection: LocalConnection, answer: LocalAnswer) -> Iterator[Any]:
        pieces, pending = answer.pieces(), b""
        heard_at = time.monotonic()
        with self._errors():
            while True:
                if not connection.has_more(_STREAM_TICK_S):
                    if time.monotonic() - heard_at > self._alive_s:
                        self._check_alive()
                        heard_at = time.monotonic()
                    yield None
                    continue
                heard_at = time.monotonic()
                piece = next(pieces, None)
                if piece is None:
                    return
                *lines, pending = (pending + piece).split(b"\n")
                yield from (parsed(line) for line in lines if line.strip())

    def _check_alive(self) -> None:
        if not self.is_alive():
            raise TimeoutError(f"no answer within {self._alive_s:g} s")

    def _connected(self) -> LocalConnection:
        return LocalConnection(self.registration, self._alive_s)

    @contextmanager
    def _errors(self) -> Iterator[None]:
        """Convert transport errors of the block to ServerLostError."""
        try:
            yield
        except _ERRORS as error:
            if isinstance(error, DriveCommError):
                raise
            raise self._lost(error) from error

    def _lost(self, error: Exception) -> ServerLostError:
        which = self.registration
        if isinstance(error, PermissionError):
            return ServerLostError(f"{which} is not contacted: {error}")
        if not which.plant:
            # A program with a port that only passes stops on has no plant.
            gone = isinstance(error, ConnectionError | FileNotFoundError)
            return ServerLostError(f"{which} has stopped" if gone else f"{which} does not answer ({error})")
        if isinstance(error, TimeoutError | BlockingIOError):
            return ServerLostError(
                f"the server of {which.plant} (pid {which.pid}) does not answer ({error}); stop it and start it again, "
                "and look at the motors: it may have carried out what was requested"
            )
        return ServerLostError(
            f"the server of {which.plant} (pid {which.pid}) has gone; start it again with drivecomm serve "
            f"{which.plant}, and look at the motors: it may have carried out what was requested"
        )


def _result(answer: LocalAnswer, data: bytes) -> Any:
    """Return the content of a response, including that of a command that was not done; raise any other error.

    Raises ValueError for an invalid response.
    """
    content = parsed(data) if data else None
    if answer.status >= BAD_REQUEST and not (isinstance(content, dict) and "outcome" in content):
        raise _refusal(content)
    return content


def _refusal(content: Any) -> DriveCommError:
    """Return the error in a response of the server. Raises ValueError."""
    try:
        return error_of(content["error"])
    except (KeyError, TypeError) as error:
        raise ValueError("an error without a description") from error
