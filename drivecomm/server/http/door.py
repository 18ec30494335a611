"""The HTTP door as a `[[door]]` of a plant file makes it, and the local one, which every server has."""

from __future__ import annotations

import ipaddress
import os
import secrets
import socket
from contextlib import suppress
from typing import TYPE_CHECKING

from drivecomm.errors import PortError, UsageError
from drivecomm.server import LOCAL, Role
from drivecomm.tomlfile import CHOICE, LIST, TEXT, Kind

if TYPE_CHECKING:
    import ssl
    from collections.abc import Callable, Collection
    from pathlib import Path

    from drivecomm.server import ServedPlant
    from drivecomm.server.http.callers import Callers
    from drivecomm.tomlfile import Table

_DEFAULT = "127.0.0.1:8080"
_BACKLOG = 1024
_HAS_UNIX_SOCKETS = hasattr(socket, "AF_UNIX") and os.name == "posix"
_KEYS = {
    "kind": TEXT,
    "listen": Kind((str,), f'an address and a port, such as "{_DEFAULT}"'),
    "certificate": Kind((str,), "the path of a PEM file in quotes"),
    "key": Kind((str,), "the path of a PEM file in quotes"),
    "names": LIST,
    "insecure": CHOICE,
    "anonymous": Kind((str,), '"view" or "nobody"'),
}


def http_door(table: Table) -> HttpDoor:
    """Return the HTTP door that a table of the plant file describes. Raises FileFormatError."""
    return HttpDoor(table)


class HttpDoor:
    """HTTP on a TCP port."""

    def __init__(self, table: Table) -> None:
        given = table.take(_KEYS)
        listen = given.get("listen", _DEFAULT)
        host, colon, port = listen.rpartition(":")
        if not (colon and host and port.isascii() and port.isdigit() and int(port) < 2**16):
            raise table.error(f"listen cannot be {listen!r}; write {_KEYS['listen'].words}", "listen")
        self._address = (host.removeprefix("[").removesuffix("]"), int(port))
        self._certificate, self._key = given.get("certificate", ""), given.get("key", "")
        if bool(self._certificate) != bool(self._key):
            raise table.error("TLS takes two files; write both certificate = and key =", "certificate")
        self._names = given.get("names", [])
        if not all(isinstance(name, str) for name in self._names):
            raise table.error('names cannot hold anything but texts; write names = ["drives.example.com"]', "names")
        self._insecure = given.get("insecure", False)
        self._is_loopback = _is_loopback(self._address[0])
        if not (self._is_loopback or self._certificate or self._insecure):
            raise table.error(
                f"{listen} can be reached from the network without encryption; write certificate = and key =, listen "
                "on 127.0.0.1, or spell out insecure = true",
                "listen",
            )
        self._anonymous = given.get("anonymous")
        if self._anonymous not in (None, "view", "nobody"):
            raise table.error(f"anonymous cannot be {self._anonymous!r}; write {_KEYS['anonymous'].words}", "anonymous")
        self._listen = listen
        self.port = 0

    @property
    def name(self) -> str:
        """How callers and events name it."""
        return f"http {self._listen}"

    async def run(self, plant: ServedPlant, opened: Callable[[], None]) -> None:
        """Serve until cancelled. Raises UsageError, FileFormatError and PortError."""
        from drivecomm.server.http.callers import TokenCallers  # noqa: PLC0415 - loads starlette

        if plant.users is None and not (self._is_loopback or self._insecure):
            raise UsageError(
                f"{self.name} can be reached from the network, and the plant has no users; write users = "
                '"users.toml" in [server], and add them with: drivecomm users add NAME, or spell out insecure = true'
            )
        anonymous = self._anonymous == "view" or (self._anonymous is None and plant.users is None and self._is_loopback)
        tls = self._tls if self._certificate else None
        listening = _listening(self._address)
        # Port 0 is any free one, and whoever reads the name wants to know which.
        self.port = listening.getsockname()[1]
        self._listen = f"{self._listen.rpartition(':')[0]}:{self.port}"
        callers = TokenCallers(users=plant.users, door=self.name, anonymous=Role.VIEW if anonymous else Role.NOBODY)
        await _run(
            plant, opened, listening, callers, name=self.name, names=[name.lower() for name in self._names], tls=tls
        )

    def _tls(self) -> ssl.SSLContext:
        import ssl  # noqa: PLC0415 - only for doors with TLS

        context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
        try:
            context.load_cert_chain(self._certificate, self._key)
        except OSError as error:
            raise UsageError(f"{self.name}: {self._certificate} and {self._key} cannot be used: {error}") from error
        return context


class LocalDoor:
    """HTTP on a unix socket, for programs of this machine; without such sockets, on a loopback port with a secret.

    socket: the path of the unix socket. port, token: how it is reached where there are no such sockets, once it is
    open; opened again it is reached the same way.
    """

    name = LOCAL

    def __init__(self, path: Path) -> None:
        self._path = path
        self.socket = str(path) if _HAS_UNIX_SOCKETS else ""
        self.port = 0
        self.token = "" if _HAS_UNIX_SOCKETS else secrets.token_urlsafe(32)

    async def run(self, plant: ServedPlant, opened: Callable[[], None]) -> None:
        """Serve until cancelled. Raises PortError."""
        from drivecomm.server.http.callers import SecretCallers, SocketCallers  # noqa: PLC0415 - loads starlette

        if not self.socket:
            listening = _listening(("127.0.0.1", self.port))
            self.port = listening.getsockname()[1]
            await _run(plant, opened, listening, SecretCallers(self.token), name=self.name, names=[], local=True)
            return
        listening = _unix_socket(self._path)
        try:
            await _run(plant, opened, listening, SocketCallers(), name=self.name, names=None, local=True)
        finally:
            with suppress(OSError):
                self._path.unlink()


async def _run(
    plant: ServedPlant,
    opened: Callable[[], None],
    listening: socket.socket,
    callers: Callers,
    *,
    name: str,
    names: Collection[str] | None,
    local: bool = False,
    tls: Callable[[], ssl.SSLContext] | None = None,
) -> None:
    """Serve a socket. names: by which it may be called besides the machine's own; None where no page can reach it."""
    from functools import partial  # noqa: PLC0415 - only for doors that run

    from drivecomm.server.http.application import application  # noqa: PLC0415 - as above
    from drivecomm.server.http.asked import DoorState  # noqa: PLC0415 - as above
    from drivecomm.server.http.guard import (  # noqa: PLC0415 - as above
        LoginRate,
        check_no_browser,
        check_place,
        own_names,
    )
    from drivecomm.server.http.metrics import Metrics  # noqa: PLC0415 - as above
    from drivecomm.server.http.serving import serve  # noqa: PLC0415 - as above
    from drivecomm.server.http.stream import Streams  # noqa: PLC0415 - as above

    streams = Streams(plant)
    state = DoorState(plant=plant, streams=streams, logins=LoginRate(), metrics=Metrics(plant, name, streams))
    check = check_no_browser if names is None else partial(check_place, names=own_names().union(names))
    with listening:
        await serve(application(state, callers, check, local=local), listening, opened, streams.close, tls)


def _listening(address: tuple[str, int]) -> socket.socket:
    host, port = address
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        return socket.create_server(address, family=family, backlog=_BACKLOG)
    except OSError as error:
        raise PortError(f"cannot listen on {host}:{port}: {error.strerror or error}; write another listen =") from error


def _unix_socket(path: Path) -> socket.socket:
    # One of a server that was killed: who runs a server here has made sure that it is the only one.
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


def _is_loopback(host: str) -> bool:
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
