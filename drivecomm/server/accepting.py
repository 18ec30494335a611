"""Acceptor of a door's connections, within bounds; when strangers fill the door, known clients still get in."""

from __future__ import annotations

import asyncio
import ipaddress
import sys
import time
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

from drivecomm.server.spare import Spare, is_exhausted

if TYPE_CHECKING:
    import socket
    import ssl
    from collections.abc import Callable

    from drivecomm.server.capacity import Bounds

_SHARE = 3
"""Rest after each connection, as a multiple of its CPU time: limits accepting to a quarter of a core."""
_ROUNDS = 2
_AGAIN_S = 0.1
"""Pause before the next attempt when no file descriptor is free for a connection."""
_HANDSHAKE_S = 10.0
_FREE_BITS = 64
"""Length of the IPv6 prefix that identifies a subscriber, who may choose the remaining bits of an address freely."""


class ClientConnection(Protocol):
    """The protocol object of one connection, made by its door."""

    def yields(self, *, to_known: bool) -> tuple[int, float] | None:
        """Return the order in which connections are closed for a newcomer (smallest first), or None to stay open.

        to_known: the newcomer comes from an address that the door knows.
        """


@dataclass(eq=False, slots=True)
class _Place:
    """One accepted connection. connected: its socket, which the transport closes."""

    connected: socket.socket
    origin: str
    since: float
    client: ClientConnection | None = None
    transport: asyncio.BaseTransport | None = None
    beginning: asyncio.Task[None] | None = field(default=None, repr=False)

    def yields(self, *, to_known: bool) -> tuple[int, float] | None:
        # A connection still in its handshake counts as a stranger's.
        return (0, self.since) if self.client is None else self.client.yields(to_known=to_known)

    def begun(self) -> None:
        self.beginning = None
        if self.transport is None:
            self.connected.close()

    def cut_off(self) -> None:
        if isinstance(self.transport, asyncio.Transport):
            self.transport.abort()
        elif self.beginning is not None:
            self.beginning.cancel()


class Acceptor:
    """The acceptor of one door's connections.

    made: makes the protocol object of a connection from the address of its peer ("" on a unix socket). known: whether
    the door knows an address. tls: for encrypted connections. spare: number of descriptors held back for connections
    that arrive when the process has no other left.
    """

    def __init__(
        self,
        bounds: Bounds,
        made: Callable[[str], Any],
        *,
        known: Callable[[str], bool] | None = None,
        tls: ssl.SSLContext | None = None,
        spare: int = 1,
    ) -> None:
        self._bounds, self._made, self._known, self._tls = bounds, made, known, tls
        self._spare = Spare(spare)
        self._places: set[_Place] = set()
        self._from = Counter[str]()

    async def run(self, listening: socket.socket) -> None:
        """Accept connections until cancelled; open connections stay open afterwards."""
        listening.setblocking(False)
        try:
            while True:
                self._spare.hold()
                connected, peer = await self._next(listening)
                began = time.thread_time()
                address = str(peer[0]) if isinstance(peer, tuple) and peer else ""
                if self._has_room(address):
                    self._begin(connected, address)
                else:
                    connected.close()
                # Two rounds of the loop: the new connection is set up, and the one that made room for it is closed.
                for _ in range(_ROUNDS):
                    await asyncio.sleep(0)
                await asyncio.sleep((time.thread_time() - began) * _SHARE)
        finally:
            self._spare.close()
            for place in self._places:
                if place.transport is None:
                    place.cut_off()

    async def _next(self, listening: socket.socket) -> tuple[socket.socket, Any]:
        while True:
            try:
                return await _accepted(listening)
            except OSError as error:
                if is_exhausted(error):
                    # accept() reports exhaustion even when no connection is pending, so wait for a connection first.
                    await _readable(listening)
                    if not self._spare.give_up():
                        self._make_room(list(self._places), to_known=False)
                        await asyncio.sleep(_AGAIN_S)

    def _has_room(self, address: str) -> bool:
        """Return whether one more connection from an address fits; may close another one to make room."""
        origin, to_known = origin_of(address), self._known is not None and self._known(address)
        most, of_address = self._bounds.most, self._bounds.of_address if origin else self._bounds.most
        if len(self._places) < most and self._from[origin] < of_address:
            return True
        # Closed connections are only removed here, when the bounds are reached.
        self._count({place for place in self._places if place.connected.fileno() >= 0})
        of_origin = [place for place in self._places if place.origin == origin]
        if len(of_origin) >= of_address and not self._make_room(of_origin, to_known=to_known):
            return False
        return len(self._places) < most or self._make_room(list(self._places), to_known=to_known)

    def _count(self, places: set[_Place]) -> None:
        self._places, self._from = places, Counter(place.origin for place in places)

    def _make_room(self, places: list[_Place], *, to_known: bool) -> bool:
        """Close the first connection in the order of `ClientConnection.yields`; return False if all stay open."""
        readiness = ((place.yields(to_known=to_known), place) for place in places)
        yielding = [(how, place) for how, place in readiness if how is not None]
        if not yielding:
            return False
        _, place = min(yielding, key=lambda each: each[0])
        place.cut_off()
        self._count(self._places - {place})
        return True

    def _begin(self, connected: socket.socket, address: str) -> None:
        place = _Place(connected, origin_of(address), time.monotonic())
        self._places.add(place)
        self._from[place.origin] += 1
        place.beginning = asyncio.create_task(self._begun(place, address), name=f"connection from {address}")
        # A task cancelled before its first step does not close its socket.
        place.beginning.add_done_callback(lambda _: place.begun())

    async def _begun(self, place: _Place, address: str) -> None:
        loop = asyncio.get_running_loop()

        def made() -> Any:
            place.client = client = self._made(address)
            return client

        # The peer may have gone already, or may fail its handshake.
        with suppress(OSError):
            place.transport, _ = await loop.connect_accepted_socket(
                made,
                place.connected,
                ssl=self._tls,
                ssl_handshake_timeout=_HANDSHAKE_S if self._tls else None,
            )


async def _accepted(listening: socket.socket) -> tuple[socket.socket, Any]:
    if sys.platform == "win32":
        return await asyncio.get_running_loop().sock_accept(listening)
    while True:
        try:
            connected, peer = listening.accept()
        except BlockingIOError:
            # Unlike `sock_accept`, this loses no connection that arrives at the moment of a cancellation.
            await _readable(listening)
        else:
            connected.setblocking(False)
            return connected, peer


async def _readable(listening: socket.socket) -> None:
    loop = asyncio.get_running_loop()
    readable = asyncio.Event()
    loop.add_reader(listening, readable.set)
    try:
        await readable.wait()
    finally:
        loop.remove_reader(listening)


def origin_of(address: str) -> str:
    """Return the key under which the connections of one peer are counted.

    For IPv6 this is the network of a subscriber, because a peer can use all addresses of its network.
    """
    try:
        found = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return address
    if isinstance(found, ipaddress.IPv4Address):
        return str(found)
    if found.ipv4_mapped is not None:
        return str(found.ipv4_mapped)
    return str(ipaddress.ip_network((found, _FREE_BITS), strict=False)) if not found.is_loopback else "::1"
