"""The HTTP door that a `[[door]]` of a plant file configures, and the local door of every server."""

from __future__ import annotations

import os
import secrets
import socket
from contextlib import suppress
from typing import TYPE_CHECKING

from drivecomm.errors import PortError, UsageError
from drivecomm.server import (
    LOCAL,
    LOCAL_BOUNDS,
    Bounds,
    DoorHealth,
    ListenAddress,
    Role,
    door_access_keys,
    read_door_access,
)
from drivecomm.tomlfile import LIST

if TYPE_CHECKING:
    import ssl
    from collections.abc import Callable, Collection
    from pathlib import Path

    from drivecomm.server import ServedPlant
    from drivecomm.server.http.callers import Callers
    from drivecomm.tomlfile import TomlTable

_DEFAULT = "127.0.0.1:8080"
_BACKLOG = 1024
_BOUNDS = Bounds(4000, 1000)
_LOCAL_SPARE = 8
"""Spare descriptors for the local door, so that local users can stop drives when the process runs out of them."""
_HAS_UNIX_SOCKETS = hasattr(socket, "AF_UNIX") and os.name == "posix"
_KEYS = {**door_access_keys(_DEFAULT), "names": LIST}


def http_door(table: TomlTable) -> HttpDoor:
    """Return the HTTP door that a table of the plant file describes. Raises FileFormatError."""
    return HttpDoor(table)


class HttpDoor:
    """Door that serves HTTP on a TCP port."""

    def __init__(self, table: TomlTable) -> None:
        given = table.take(_KEYS)
        self._way_in = read_door_access(table, given, _DEFAULT)
        self._names = given.get("names", [])
        if not all(isinstance(name, str) for name in self._names):
            raise table.error('names is not a list of texts; write names = ["drives.example.com"]', "names")
        self._listen = given.get("listen", _DEFAULT)
        self.port = 0
        self.connections = _BOUNDS
        self.clients: set[object] = set()

    @property
    def name(self) -> str:
        """Name of the door in callers and events."""
        return f"http {self._listen}"

    def health(self) -> DoorHealth:
        """Return the health of the door, with its number of connected clients."""
        return DoorHealth(clients=len(self.clients))

    async def run(self, plant: ServedPlant, opened: Callable[[], None]) -> None:
        """Serve until cancelled. Raises UsageError, FileFormatError and PortError."""
        from drivecomm.server.http.callers import TokenCallers

        self._way_in.check_users(self.name, plant.users)
        anonymous = Role.VIEW if self._way_in.shows_strangers(plant.users) else Role.NOBODY
        tls = self._tls if self._way_in.certificate else None
        listening = self._way_in.address.open()
        # Port 0 means any free port; the name has to show which one it became.
        self.port = listening.getsockname()[1]
        self._listen = f"{self._listen.rpartition(':')[0]}:{self.port}"
        callers = TokenCallers(users=plant.users, door=self.name, anonymous=anonymous)
        names = [name.lower() for name in self._names]
        await _run(self, plant, opened, listening, callers, names=names, tls=tls)

    def _tls(self) -> ssl.SSLContext:
        import ssl

        certificate, key = self._way_in.certificate or ("", "")
        context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
        try:
            context.load_cert_chain(certificate, key)
        except OSError as error:
            raise UsageError(f"{self.name}: {certificate} and {key} cannot be used: {error}") from error
        return context


class LocalDoor:
    """HTTP on a unix socket for local programs; without unix sockets, on a loopback port with a secret.

    socket: path of the unix socket, "" without unix sockets. port, token: port and secret without unix sockets; the
    port is known once the door is open and stays the same when the door opens again.
    """

    name = LOCAL

    def __init__(self, path: Path) -> None:
        self._path = path
        self.socket = str(path) if _HAS_UNIX_SOCKETS else ""
        self.port = 0
        self.token = "" if _HAS_UNIX_SOCKETS else secrets.token_urlsafe(32)
        self.connections = LOCAL_BOUNDS
        self.clients: set[object] = set()

    def health(self) -> DoorHealth:
        """Return the health of the door, with its number of connected clients."""
        return DoorHealth(clients=len(self.clients))

    async def run(self, plant: ServedPlant, opened: Callable[[], None]) -> None:
        """Serve until cancelled. Raises PortError."""
        from drivecomm.server.http.callers import SecretCallers, SocketCallers

        if self.socket:
            try:
                await _run(self, plant, opened, _unix_socket(self._path), SocketCallers(), names=None)
            finally:
                with suppress(OSError):
                    self._path.unlink()
            return
        listening = ListenAddress("127.0.0.1", self.port).open()
        self.port = listening.getsockname()[1]
        await _run(self, plant, opened, listening, SecretCallers(self.token), names=[])


async def _run(
    door: HttpDoor | LocalDoor,
    plant: ServedPlant,
    opened: Callable[[], None],
    listening: socket.socket,
    callers: Callers,
    *,
    names: Collection[str] | None,
    tls: Callable[[], ssl.SSLContext] | None = None,
) -> None:
    """Serve a listening socket.

    names: host names accepted besides those of this machine; None if no web page can reach the socket.
    """
    from functools import partial

    from drivecomm.server.http.application import application
    from drivecomm.server.http.guard import LoginRate, check_no_browser, check_place, own_names
    from drivecomm.server.http.metrics import Metrics
    from drivecomm.server.http.route import HttpDoorState
    from drivecomm.server.http.serving import serve
    from drivecomm.server.http.stream import Streams

    local = isinstance(door, LocalDoor)
    streams = Streams(plant)
    metrics = Metrics(plant, door.name, streams)
    state = HttpDoorState(
        plant=plant, streams=streams, logins=LoginRate(), metrics=metrics, callers=callers, local=local
    )
    check = check_no_browser if names is None else partial(check_place, names=own_names().union(names))
    with listening:
        served, spare = application(state, check), _LOCAL_SPARE if local else 1
        await serve(
            served, listening, opened, streams.close, tls, bounds=door.connections, spare=spare, clients=door.clients
        )


def _unix_socket(path: Path) -> socket.socket:
    # A killed server leaves its socket behind. The caller has made sure that no other server runs here.
    path.unlink(missing_ok=True)
    listening = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        before = os.umask(0o177)
        try:
            listening.bind(str(path))
        finally:
            os.umask(before)
        listening.listen(_BACKLOG)
    except OSError as error:
        listening.close()
        raise PortError(f"cannot make the local door at {path}: {error.strerror or error}") from error
    return listening
