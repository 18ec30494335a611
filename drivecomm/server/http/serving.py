"""A listening socket served by uvicorn, without its signals and its logs, until it is cancelled."""

from __future__ import annotations

import asyncio
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from uvicorn import Config, Server
from uvicorn.protocols.http.h11_impl import H11Protocol

if TYPE_CHECKING:
    import socket
    import ssl
    from collections.abc import Awaitable, Callable, Iterator

    from starlette.types import ASGIApp

MOST_CONNECTIONS = 4000
_FIRST_REQUEST_S = 10.0
_KEEP_ALIVE_S = 75
_END_S = 0.5
_NEW_DATE_S = 1.0
"""How often the header with the date is made."""


class _Connection(H11Protocol):
    """Says in each request on which transport it came, and does not wait for the first one for ever."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        self.app_state = {**self.app_state, "transport": transport}
        super().connection_made(transport)
        self.timeout_keep_alive_task = self.loop.call_later(_FIRST_REQUEST_S, self.timeout_keep_alive_handler)


class _Server(Server):
    """Says when it listens, and ends at once; signals are the business of the process."""

    opened: Callable[[], None]

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        self._end = asyncio.Event()

    def end(self) -> None:
        """Take no further connections, and come to an end."""
        self.should_exit = True
        self._end.set()

    async def main_loop(self) -> None:
        # uvicorn's own looks ten times a second whether it shall end.
        while not await self.on_tick(0):
            with suppress(TimeoutError):
                await asyncio.wait_for(self._end.wait(), _NEW_DATE_S)

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        self.opened()


async def serve(
    app: ASGIApp,
    listening: socket.socket,
    opened: Callable[[], None],
    ending: Callable[[], Awaitable[None]],
    tls: Callable[[], ssl.SSLContext] | None = None,
) -> None:
    """Serve until cancelled, and then end within a second.

    opened: called when it can be used. ending: called first when it ends, for what would go on for ever. tls: makes
    the context of connections; None for plain ones.
    """
    config = Config(
        app, http=_Connection, ws="none", lifespan="off", loop="asyncio", log_config=None, log_level="error",
        access_log=False, proxy_headers=False, server_header=False, limit_concurrency=MOST_CONNECTIONS,
        timeout_keep_alive=_KEEP_ALIVE_S, timeout_graceful_shutdown=1,
    )  # fmt: skip
    config.load()
    config.ssl = tls() if tls else None
    server = _Server(config)
    server.opened = opened
    serving = asyncio.create_task(server.serve(sockets=[listening]))
    try:
        await asyncio.shield(serving)
    finally:
        server.end()
        await ending()
        await asyncio.wait({serving}, timeout=_END_S)
        for connection in list(server.server_state.connections):
            connection.transport.abort()
        await asyncio.wait({serving}, timeout=_END_S)
        serving.cancel()
