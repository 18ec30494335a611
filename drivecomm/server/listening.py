"""TCP addresses on which doors listen, read from their tables."""

from __future__ import annotations

import ipaddress
import socket
from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivecomm.errors import PortError, reason_of
from drivecomm.tomlfile import Kind

if TYPE_CHECKING:
    from drivecomm.tomlfile import TomlTable

_BACKLOG = 1024


@dataclass(frozen=True, slots=True)
class ListenAddress:
    """An address and a port of this machine; port 0 stands for any free port."""

    host: str
    port: int

    def __str__(self) -> str:
        return f"[{self.host}]:{self.port}" if ":" in self.host else f"{self.host}:{self.port}"

    @property
    def is_loopback(self) -> bool:
        """Whether only this machine can reach the address."""
        return is_loopback(self.host)

    def open(self) -> socket.socket:
        """Return a socket that listens on this address. Raises PortError."""
        family = socket.AF_INET6 if ":" in self.host else socket.AF_INET
        try:
            listening = socket.create_server((self.host, self.port), family=family, backlog=_BACKLOG)
        except OSError as error:
            raise PortError(
                f"cannot listen on {self.host}:{self.port}: {reason_of(error)}; write another listen ="
            ) from error
        # Connections inherit this option, and asyncio sets it only on sockets that it made itself.
        # Without it, each value waits for the acknowledgement of the previous one, which takes up to 40 ms.
        listening.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return listening


def is_loopback(host: str) -> bool:
    """Return whether a host name or address means this machine."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def listen_kind(usual: str) -> Kind:
    """Return the kind of the key `listen` in a door's table. usual: the default address, named in error messages."""
    return Kind((str,), f'an address and a port, such as "{usual}"')


def listen_address(table: TomlTable, said: str, usual: str) -> ListenAddress:
    """Return the address that `listen` names in a door's table. Raises FileFormatError."""
    host, colon, port = said.rpartition(":")
    if not (colon and host and port.isascii() and port.isdigit() and int(port) < 2**16):
        raise table.error(f"invalid listen = {said!r}; write {listen_kind(usual).words}", "listen")
    return ListenAddress(host.removeprefix("[").removesuffix("]"), int(port))
