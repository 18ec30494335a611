"""A listening socket served by uvicorn until cancelled, without uvicorn's signal handling and logs."""

from __future__ import annotations

import asyncio
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from uvicorn import Config, Server
from uvicorn.protocols.http.h11_impl import H11Protocol

from drivecomm.server import Acceptor

if TYPE_CHECKING:
    import socket
    import ssl
    from collections.abc import Awaitable, Callable, Iterator

    from starlette.types import ASGIApp

    from drivecomm.server import Bounds

_FIRST_REQUEST_S = 10.0
_KEEP_ALIVE_S = 75
_END_S = 0.5
_NEW_DATE_S = 1.0
"""Seconds between updates of the Date header."""


@dataclass(slots=True)
class ConnectionState:
    """State of one connection as seen by the door.

    known: a named user has sent a request on it. streams: its current request is an endless stream, which the client
    can request again.
    """

    known: bool = False
    streams: bool = False


class _Connection(H11Protocol):
    """HTTP connection that exposes its transport to each request and times out if the first request does not arrive."""

    def __init__(self, clients: set[object], **given: Any) -> None:
        super().__init__(**given)
        self._clients = clients
        self._standing = ConnectionState()
        self._quiet_since_s = self.loop.time()

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        self.app_state = {**self.app_state, "transport": transport, "standing": self._standing}
        super().connection_made(transport)
        self._clients.add(self)
        self.timeout_keep_alive_task = self.loop.call_later(_FIRST_REQUEST_S, self.timeout_keep_alive_handler)

    def connection_lost(self, exc: Exception | None) -> None:
        self._clients.discard(self)
        super().connection_lost(exc)

    def on_response_complete(self) -> None:
        if self._standing.known:
            # Only users refresh the idle time: a stranger cannot avoid being closed as the longest idle.
            self._quiet_since_s = self.loop.time()
        super().on_response_complete()

    def yields(self, *, to_known: bool) -> tuple[int, float] | None:  # noqa: ARG002 - it is not known who will ask
        """Rank this connection for closing: idle strangers first, then busy strangers, idle users, streams of users.

        Other requests of users, such as commands, are never cut off.
        """
        busy = self.cycle is not None and not self.cycle.response_complete
        if not self._standing.known:
            return int(busy), self._quiet_since_s
        if not busy:
            return 2, self._quiet_since_s
        return (3, self._quiet_since_s) if self._standing.streams else None


class _Server(Server):
    """uvicorn server that reports when it listens and ends without delay; it leaves signals to the process."""

    opened: Callable[[], None]

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        self._end = asyncio.Event()

    def end(self) -> None:
        """Stop accepting connections and shut down."""
        self.should_exit = True
        self._end.set()

    async def main_loop(self) -> None:
        # uvicorn's own loop polls ten times a second for shutdown.
        while not await self.on_tick(0):
            with suppress(TimeoutError):
                await asyncio.wait_for(self._end.wait(), _NEW_DATE_S)

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:  # noqa: ARG002 - there are none
        # `Acceptor` accepts the connections instead, within limits that uvicorn does not know.
        self.servers, self.started = [], True
        self.opened()


async def serve(
    app: ASGIApp,
    listening: socket.socket,
    opened: Callable[[], None],
    ending: Callable[[], Awaitable[None]],
    tls: Callable[[], ssl.SSLContext] | None = None,
    *,
    bounds: Bounds,
    clients: set[object],
    spare: int = 1,
) -> None:
    """Serve until cancelled, then shut down within a second.

    opened: called once the socket is served. ending: called first at shutdown, to end endless responses. tls: makes the
    TLS context; None for plain HTTP. bounds, spare: see `Acceptor`. clients: filled with the open connections.
    """
    config = Config(
        app, http=_Connection, ws="none", lifespan="off", loop="asyncio", log_config=None, log_level="error",
        access_log=False, proxy_headers=False, server_header=False,
        timeout_keep_alive=_KEEP_ALIVE_S, timeout_graceful_shutdown=1,
    )  # fmt: skip
    config.load()
    server = _Server(config)
    server.opened = opened

    def connection(_: str) -> _Connection:
        return _Connection(clients, config=config, server_state=server.server_state, app_state={})

    acceptor = Acceptor(bounds, connection, tls=tls() if tls else None, spare=spare)
    serving = asyncio.create_task(server.serve())
    accepting = asyncio.create_task(acceptor.run(listening))
    try:
        await asyncio.wait({serving, accepting}, return_when=asyncio.FIRST_COMPLETED)
        for ended in (serving, accepting):
            if ended.done():
                ended.result()
    finally:
        accepting.cancel()
        server.end()
        await ending()
        await asyncio.wait({serving, accepting}, timeout=_END_S)
        for connection_left in list(server.server_state.connections):
            connection_left.transport.abort()
        await asyncio.wait({serving}, timeout=_END_S)
        serving.cancel()
