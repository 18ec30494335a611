"""Access settings of doors that listen on a TCP port: the keys that such doors share.

listen = "0.0.0.0:8443"         # on loopback unless given
certificate = "hall2.pem"       # with key, beside the plant file: encrypts the connections
key = "hall2.key"
anonymous = "view"              # or "nobody": the role of callers without a login
insecure = true                 # on a network without encryption, or without users
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from drivecomm.errors import UsageError
from drivecomm.server.listening import listen_address, listen_kind
from drivecomm.tomlfile import CHOICE, TEXT, Kind

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from drivecomm.server.door import KnownUsers
    from drivecomm.server.listening import ListenAddress
    from drivecomm.tomlfile import TomlTable

_ANONYMOUS = Kind((str,), '"view" or "nobody"')
_FILE = Kind((str,), "the path of a file in quotes")


def door_access_keys(usual: str) -> Mapping[str, Kind]:
    """Return the keys that a door adds to its own. usual: the default address."""
    return {
        "kind": TEXT,
        "listen": listen_kind(usual),
        "certificate": _FILE,
        "key": _FILE,
        "insecure": CHOICE,
        "anonymous": _ANONYMOUS,
    }


@dataclass(frozen=True, slots=True)
class DoorAccess:
    """Access settings of one door, from its table.

    certificate: paths of the certificate and its key; None without TLS.
    """

    address: ListenAddress
    certificate: tuple[Path, Path] | None
    insecure: bool
    anonymous: str | None

    def check_users(self, door: str, users: KnownUsers | None) -> None:
        """Raise UsageError if anyone on a network could use the door, because the plant has no users."""
        if users is None and not (self.address.is_loopback or self.insecure):
            raise UsageError(
                f"{door} can be reached from the network, and the plant has no users; write users = "
                '"users.toml" in [server], and add them with: drivecomm users add NAME, or set insecure = true'
            )

    def shows_strangers(self, users: KnownUsers | None) -> bool:
        """Return whether callers without a login may see everything."""
        return self.anonymous == "view" or (self.anonymous is None and users is None and self.address.is_loopback)


def read_door_access(table: TomlTable, given: Mapping[str, Any], usual: str) -> DoorAccess:
    """Return the access settings in a table. Raises FileFormatError with its line.

    given: the keys of the table, whose kinds were checked by `door_access_keys`.
    """
    listen = given.get("listen", usual)
    address = listen_address(table, listen, usual)
    files = given.get("certificate"), given.get("key")
    if bool(files[0]) != bool(files[1]):
        raise table.error("encryption needs two files; write both certificate = and key =", "certificate")
    insecure = given.get("insecure", False)
    if not (address.is_loopback or files[0] or insecure):
        raise table.error(
            f"{listen} can be reached from the network without encryption; write certificate = and key =, listen "
            "on 127.0.0.1, or set insecure = true",
            "listen",
        )
    anonymous = given.get("anonymous")
    if anonymous not in (None, "view", "nobody"):
        raise table.error(f"invalid anonymous = {anonymous!r}; write {_ANONYMOUS.words}", "anonymous")
    certificate = (table.beside(files[0]), table.beside(files[1])) if files[0] and files[1] else None
    return DoorAccess(address, certificate, insecure, anonymous)
