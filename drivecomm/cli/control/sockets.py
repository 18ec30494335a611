"""The control socket of a serial port that a program holds: in its owner's runtime folder, named after the port.

Only the owner of the folder can reach it. Without Unix sockets it is a TCP port of this machine, and a file in the
folder holds its number and two secrets, by which the two sides recognise each other.
"""

from __future__ import annotations

import json
import os
import socket
import struct
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any
from urllib.parse import quote, urlsplit

from drivecomm.client import is_private, users_folder

LONGEST_LINE = 1 << 16
_HAS_UNIX_SOCKETS = hasattr(socket, "AF_UNIX") and os.name == "posix"
_CHUNK = 4096


def socket_file(port: str) -> Path:
    """Return the path of the control socket of a port, by whatever name or link the port is called."""
    return users_folder() / f"{quote(_one_name(port), safe='')}.control"


def _one_name(port: str) -> str:
    if "://" not in port:
        return port.upper() if os.name == "nt" else os.path.realpath(port)
    parts = urlsplit(port)
    # Raw TCP and RFC 2217 lead to the same line.
    host = (parts.hostname or "").replace("localhost", "127.0.0.1")
    return f"{host}:{parts.port}"


class ControlSocket:
    """Accepts programs of the same user until it is closed. Raises OSError."""

    def __init__(self, file: Path) -> None:
        self._file = file
        file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        if not is_private(file.parent):
            raise PermissionError(f"{file.parent} belongs to another user, or others can write to it")
        other = connect(file)
        if other is not None:
            other.close()
            raise FileExistsError("another program has the control socket of this port")
        file.unlink(missing_ok=True)
        self._secrets = ("", "")
        if _HAS_UNIX_SOCKETS:
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        else:
            self._socket = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
            self._secrets = (os.urandom(16).hex(), os.urandom(16).hex())
        try:
            self._bind()
        except OSError:
            self._socket.close()
            raise

    def accept(self, wait_s: float) -> Connection | None:
        """Return the next program that connects within this time; None when none does."""
        self._socket.settimeout(wait_s)
        try:
            connection = Connection(self._socket.accept()[0])
        except OSError:
            return None
        asked, answered = self._secrets
        if asked:
            with suppress(OSError, ValueError):
                if _is_secret(connection.read(1.0), asked):
                    connection.write(secret=answered)
                    return connection
            connection.close()
            return None
        return connection

    def close(self) -> None:
        """Accept nobody any more, and remove the file."""
        self._file.unlink(missing_ok=True)
        self._socket.close()

    def _bind(self) -> None:
        if _HAS_UNIX_SOCKETS:
            # Nobody can connect before the socket listens.
            self._socket.bind(str(self._file))
            self._file.chmod(0o600)
            self._socket.listen()
            return
        self._socket.bind(("127.0.0.1", 0))
        self._socket.listen()
        descriptor = os.open(self._file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(descriptor, "w", encoding="utf-8") as file:
            json.dump([self._socket.getsockname()[1], *self._secrets], file)


def connect(file: Path, limit_s: float = 1.0) -> Connection | None:
    """Return a connection to the program that has this socket; None when there is none, and a stale file is removed.

    Raises OSError when a program is there that accepts nobody.
    """
    if not file.exists() or not is_private(file.parent):
        return None
    try:
        if _HAS_UNIX_SOCKETS:
            connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            try:
                connection.settimeout(limit_s)
                connection.connect(str(file))
            except OSError:
                connection.close()
                raise
            return Connection(connection)
        return _connect_by_tcp(file, limit_s)
    except (ConnectionRefusedError, FileNotFoundError):
        # The program was killed.
        file.unlink(missing_ok=True)
        return None


def _connect_by_tcp(file: Path, limit_s: float) -> Connection:
    number, asked, answered = json.loads(file.read_text(encoding="utf-8"))
    connection = Connection(socket.create_connection(("127.0.0.1", number), timeout=limit_s))
    try:
        connection.write(secret=asked)
        if _is_secret(connection.read(limit_s), answered):
            return connection
    except (OSError, ValueError):
        pass
    connection.close()
    # Another program has the number now.
    raise ConnectionRefusedError


def _is_secret(told: dict[str, Any], secret: str) -> bool:
    from hmac import compare_digest  # noqa: PLC0415 - only where there are no Unix sockets

    return compare_digest(str(told.get("secret")).encode(), secret.encode())


class Connection:
    """JSON objects, one a line, in either direction; no line is longer than `LONGEST_LINE`."""

    def __init__(self, connected: socket.socket) -> None:
        self._socket = connected
        self._pending = b""

    @property
    def pid(self) -> int | None:
        """The process at the other end, where the system tells it; also of one that hangs."""
        if sys.platform == "linux" and self._socket.family == socket.AF_UNIX:
            return int(struct.unpack("3i", self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, 12))[0])
        return None

    def write(self, **content: Any) -> None:
        """Send an object. Raises OSError."""
        self._socket.sendall(json.dumps(content).encode() + b"\n")

    def read(self, limit_s: float) -> dict[str, Any]:
        """Return the next object. Raises TimeoutError, ConnectionError, ValueError or TypeError."""
        self._socket.settimeout(limit_s)
        while b"\n" not in self._pending:
            if len(self._pending) > LONGEST_LINE:
                raise ValueError("a line that does not end")
            piece = self._socket.recv(_CHUNK)
            if not piece:
                raise ConnectionResetError("the other program has gone")
            self._pending += piece
        line, _, self._pending = self._pending.partition(b"\n")
        content = json.loads(line)
        if not isinstance(content, dict):
            raise TypeError("not an object")
        return content

    def close(self) -> None:
        """End the connection."""
        self._socket.close()
