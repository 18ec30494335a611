"""Comparison of port names: a file and its link are the same port, as are two names of a server."""

from __future__ import annotations

import os
import re
import stat
import sys
from pathlib import Path
from urllib.parse import urlsplit

ONE_PROTOCOL = {"modbus-tcp": 502}
"""Schemes of TCP connections that carry a single protocol, with their default port numbers."""

_HERE = frozenset({"localhost", "127.0.0.1", "::1"})


def scheme_of(port: str) -> str:
    """Return the scheme of a URL, "" for the name of a local port."""
    return port.split("://", 1)[0].lower() if "://" in port else ""


def tcp_place(url: str) -> tuple[str, int]:
    """Return host and port number of a URL; 0 without a number, which is never a valid port. Raises ValueError."""
    parts = urlsplit(url)
    return parts.hostname or "", parts.port or ONE_PROTOCOL.get(parts.scheme, 0)


def same_port(one: str, other: str) -> bool:
    """Whether two names, as `open_bus` accepts them, mean the same port; an empty name never does."""
    return bool(one and other) and (one == other or _place(one) == _place(other))


def _place(port: str) -> object:
    if "://" not in port:
        return _device(port) or os.path.normcase(os.path.realpath(port.removeprefix("\\\\.\\")))
    try:
        host, number = tcp_place(port)
    except ValueError:
        return port
    # A server has one line per port number, whatever scheme is used for it.
    host = host.rstrip(".")
    return ("here" if host.removeprefix("::ffff:") in _HERE else host, number)


def _device(port: str) -> int:
    """Return the device number of a file, which is the same for all nodes of a device; 0 for other files."""
    try:
        found = os.stat(port)  # noqa: PTH116 - a name that is no path on some systems
    except (OSError, ValueError):
        return 0
    return found.st_rdev if stat.S_ISCHR(found.st_mode) else 0


_BY_ID = Path("/dev/serial/by-id")


def stable_name(url: str, by_id: Path = _BY_ID) -> str:
    """Return the link in this folder that leads to the port; the name itself without such a link.

    A URL, or a name that is already a link, was chosen by the user and is returned unchanged.
    """
    if "://" in url:
        return url
    try:
        if Path(url).is_symlink():
            return url
        port = Path(url).resolve(strict=True)
        # The dangling link of a removed adapter matches no port.
        return min((str(link) for link in by_id.iterdir() if link.resolve() == port), default=url)
    except (OSError, ValueError):
        # The folder or the port does not exist.
        return url


# Linux, Documentation/admin-guide/devices.txt: the slave ends of pseudo-terminals.
_LINUX_MAJORS = range(136, 144)
_NAMES = re.compile(r"/dev/(pts/\d+|ttys\d+|tty[p-zP-T][0-9a-f])")


def is_pseudo(descriptor: int) -> bool:
    """Whether this open terminal is the slave end of a pseudo-terminal."""
    if sys.platform == "linux":
        return os.major(os.fstat(descriptor).st_rdev) in _LINUX_MAJORS
    try:
        return _NAMES.fullmatch(os.ttyname(descriptor)) is not None
    except OSError:
        return False
