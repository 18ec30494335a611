"""The connections of a door on a listening socket, within bounds: who is known gets in when strangers fill the door."""

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
"""After work the acceptor rests for this many times as long: connections that come and go cost a quarter of a core."""
_ROUNDS = 2
_AGAIN_S = 0.1
"""When it tries again if there is no descriptor for a connection."""
_HANDSHAKE_S = 10.0
_FREE_BITS = 64
"""An IPv6 subscriber has this many bits of an address to choose from."""


class Client(Protocol):
    """The protocol of one connection, as its door makes it."""

    def yields(self, *, to_known: bool) -> tuple[int, float] | None:
        """Return how readily this is closed for a newcomer: the smallest goes first; None if it is not.

        to_known: the newcomer is one of those whom the door knows by their address.
        """


@dataclass(eq=False, slots=True)
class _Place:
    """A connection that was let in. connected is closed by its transport."""

    connected: socket.socket
    origin: str
    since: float
    client: Client | None = None
    transport: asyncio.BaseTransport | None = None
    beginning: asyncio.Task[None] | None = field(default=None, repr=False)

    def yields(self, *, to_known: bool) -> tuple[int, float] | None:
        # One that still shakes hands is a stranger's.
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
    """Lets connections in. made: makes the protocol of one, of its peer's address, empty on a unix socket.

    known: whether the door knows those at an address. tls: for encrypted connections. spare: descriptors that are held
    for connections which come when the process has none left.
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
        """Let connections in until cancelled; those that are open stay so."""
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
                # In these rounds of the loop it is made, and the one that made room for it is closed.
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
                    # The system says so before it looks whether there is a connection.
                    await _readable(listening)
                    if not self._spare.give_up():
                        self._make_room(list(self._places), to_known=False)
                        await asyncio.sleep(_AGAIN_S)

    def _has_room(self, address: str) -> bool:
        """Whether one more may come from an address, if need be in the place of one that yields."""
        origin, to_known = origin_of(address), self._known is not None and self._known(address)
        most, of_address = self._bounds.most, self._bounds.of_address if origin else self._bounds.most
        if len(self._places) < most and self._from[origin] < of_address:
            return True
        # Those that have gone are only looked for now.
        self._count({place for place in self._places if place.connected.fileno() >= 0})
        of_origin = [place for place in self._places if place.origin == origin]
        if len(of_origin) >= of_address and not self._make_room(of_origin, to_known=to_known):
            return False
        return len(self._places) < most or self._make_room(list(self._places), to_known=to_known)

    def _count(self, places: set[_Place]) -> None:
        self._places, self._from = places, Counter(place.origin for place in places)

    def _make_room(self, places: list[_Place], *, to_known: bool) -> bool:
        """Cut off the one of these that yields most readily; return whether there was one."""
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
        # One that is cancelled before its first step closes nothing itself.
        place.beginning.add_done_callback(lambda _: place.begun())

    async def _begun(self, place: _Place, address: str) -> None:
        loop = asyncio.get_running_loop()

        def made() -> Any:
            place.client = client = self._made(address)
            return client

        # A peer that is gone already, or fails its handshake.
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
            # Unlike `sock_accept`, this loses no connection that comes in the moment of a cancellation.
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
    """Return what all addresses have in common that one peer may choose from: of IPv6, the network of a subscriber."""
    try:
        found = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return address
    if isinstance(found, ipaddress.IPv4Address):
        return str(found)
    if found.ipv4_mapped is not None:
        return str(found.ipv4_mapped)
    return str(ipaddress.ip_network((found, _FREE_BITS), strict=False)) if not found.is_loopback else "::1"
