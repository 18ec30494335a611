"""Broker settings of a `[[door]]`: its address, the login of the door, and encryption.

broker = "mqtts://broker.example.com"   # or mqtt://, with a port if it is not 8883 or 1883
user = "hall2"
password = "@broker"                    # the file broker of $CREDENTIALS_DIRECTORY, or $DRIVECOMM_BROKER_BROKER
password_file = "broker.password"       # instead; only its owner can read it
authority = "ca.pem"                    # issuer of the broker's certificate; the system's unless given
certificate = "hall2.pem"               # the door's own, with
key = "hall2.key"
client_id = "hall2"                     # unique on the broker
keep_alive_s = 15                       # interval of keep-alive messages, which reveal a dead connection
version = "3.1.1"                       # "5" unless given
insecure = true                         # without TLS to a broker on another machine
"""

from __future__ import annotations

import os
import re
import stat
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from drivecomm.errors import UsageError
from drivecomm.server import is_loopback
from drivecomm.tomlfile import CHOICE, SECONDS, TEXT, Kind

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from drivecomm.tomlfile import TomlTable

_URL = Kind((str,), '"mqtt://127.0.0.1:1883", or mqtts:// and the name of a broker')
_FILE = Kind((str,), "the path of a PEM file in quotes")
_PASSWORD = Kind((str,), '"@name", which stands for the file name of $CREDENTIALS_DIRECTORY or $DRIVECOMM_BROKER_NAME')
BROKER_KEYS = {
    "broker": _URL,
    "user": TEXT,
    "password": _PASSWORD,
    "password_file": Kind((str,), "the path of a file in quotes that only its owner can read"),
    "authority": _FILE,
    "certificate": _FILE,
    "key": _FILE,
    "client_id": TEXT,
    "keep_alive_s": SECONDS,
    "version": Kind((str,), '"5" or "3.1.1"'),
    "insecure": CHOICE,
}
"""Keys for the table of a door that uses a broker."""

_SCHEMES = {"mqtt": 1883, "mqtts": 8883}
VERSIONS = ("5", "3.1.1")
_SECRET = re.compile(r"@([A-Za-z0-9_-]+)")
_ENVIRONMENT = "DRIVECOMM_BROKER_"
_LONGEST_PASSWORD = 4096
_SHORTEST_S, _LONGEST_S = 2, 600


@dataclass(frozen=True, slots=True, kw_only=True)
class BrokerSettings:
    """A broker, and the login of the door there.

    password: looked up at each connection, so that it can be changed; None without one. Raises UsageError if it cannot
    be found. client_id: empty if the door chooses one. version: of MQTT, "5" or "3.1.1".
    """

    host: str
    port: int
    tls: bool = False
    user: str = ""
    password: Callable[[], str] | None = field(default=None, repr=False)
    authority: Path | None = None
    certificate: Path | None = None
    key: Path | None = None
    client_id: str = ""
    keep_alive_s: int = 15
    version: str = "5"

    @property
    def place(self) -> str:
        """The name of the broker in events: host and port."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{host}:{self.port}"


def broker_settings(
    table: TomlTable, given: Mapping[str, Any], environment: Mapping[str, str] = os.environ
) -> BrokerSettings:
    """Return the broker settings in a table. Raises FileFormatError with its line.

    given: the keys of the table, whose kinds were checked by BROKER_KEYS.
    """
    host, port, tls = _place(table, given.get("broker", "mqtt://127.0.0.1"))
    if not (tls or given.get("insecure", False) or is_loopback(host)):
        raise table.error(
            f"{host} is another machine, and data sent there could be read and changed in transit; write "
            f'broker = "mqtts://{host}", or set insecure = true',
            "broker",
        )
    if bool(given.get("certificate")) != bool(given.get("key")):
        raise table.error("a certificate needs two files; write both certificate = and key =", "certificate")
    for name in ("authority", "certificate"):
        if given.get(name) and not tls:
            raise table.error(f"{name} is for brokers with TLS; write mqtts:// or leave it out", name)
    if given.get("version", "5") not in VERSIONS:
        raise table.error(f"invalid version = {given['version']!r}; write {BROKER_KEYS['version'].words}", "version")
    if not given.get("client_id", "").isprintable():
        raise table.error("client_id has characters that brokers refuse; write letters, digits, - and _", "client_id")
    keep_alive_s = given.get("keep_alive_s", 15)
    if not _SHORTEST_S <= keep_alive_s <= _LONGEST_S:
        raise table.error(
            f"invalid keep_alive_s = {keep_alive_s:g}; write {_SHORTEST_S} to {_LONGEST_S} seconds", "keep_alive_s"
        )
    return BrokerSettings(
        host=host,
        port=port,
        tls=tls,
        user=given.get("user", ""),
        password=_password(table, given, environment),
        client_id=given.get("client_id", ""),
        keep_alive_s=round(keep_alive_s),
        version=given.get("version", "5"),
        **{name: table.beside(given[name]) for name in ("authority", "certificate", "key") if given.get(name)},
    )


def _place(table: TomlTable, url: str) -> tuple[str, int, bool]:
    try:
        parts = urlsplit(url)
        port = parts.port
    except ValueError:
        parts, port = urlsplit(""), None
    if "@" in parts.netloc:
        raise table.error("broker names a user; write user = and password_file =, which are apart from it", "broker")
    if parts.scheme not in _SCHEMES or not parts.hostname or port == 0 or parts.path.strip("/") or parts.query:
        raise table.error(f"invalid broker = {url!r:.80}; write {_URL.words}", "broker")
    return parts.hostname, port or _SCHEMES[parts.scheme], parts.scheme == "mqtts"


def _password(table: TomlTable, given: Mapping[str, Any], environment: Mapping[str, str]) -> Callable[[], str] | None:
    said, file = given.get("password"), given.get("password_file")
    if said is None and file is None:
        return None
    if not given.get("user"):
        raise table.error("a password needs a user; write user =", "password" if said else "password_file")
    if said is not None and file is not None:
        raise table.error("password and password_file exclude each other; leave one of them out", "password")
    if file is not None:
        path = table.beside(file)
        return lambda: first_line(path)
    found = _SECRET.fullmatch(said or "")
    if not found:
        # The text is not repeated in the error, because it may be a password.
        raise table.error(f"a password does not belong in a plant file; write {_PASSWORD.words}", "password")
    name = found[1]
    return lambda: _secret(name, environment)


def _secret(name: str, environment: Mapping[str, str]) -> str:
    from pathlib import Path

    variable = _ENVIRONMENT + re.sub("-", "_", name).upper()
    if folder := environment.get("CREDENTIALS_DIRECTORY"):
        path = Path(folder) / name
        if path.is_file():
            # The program that created this folder is responsible for its permissions.
            return _text_of(path)
    if found := environment.get(variable, ""):
        return found
    raise UsageError(
        f"there is no password @{name}; put it into the file {name} of $CREDENTIALS_DIRECTORY, or into ${variable}"
    )


def first_line(path: Path) -> str:
    """Return the secret in the first line of a file that only its owner can read. Raises UsageError."""
    if os.name == "posix" and path.is_file():
        found = path.stat()
        # A file that root provides for a service may be readable for the group of the service.
        if stat.S_IMODE(found.st_mode) & (0o037 if found.st_uid == 0 else 0o077):
            raise UsageError(f"{path}: others can read or write this password; run chmod 600 {path}")
    return _text_of(path)


def _text_of(path: Path) -> str:
    try:
        with path.open(encoding="utf-8-sig") as file:
            text = file.read(_LONGEST_PASSWORD)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not a text"
        raise UsageError(f"{path}: the password cannot be read: {reason}") from error
    password = text.splitlines()[0] if text else ""
    if not password:
        raise UsageError(f"{path}: there is no password in it; write it into the first line")
    return password
