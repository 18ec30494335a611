"""Whether two names mean the same port: a file and its link, one server called in two ways."""

from __future__ import annotations

import os
import re
import stat
import sys
from pathlib import Path
from urllib.parse import urlsplit

ONE_PROTOCOL = {"modbus-tcp": 502}
"""Schemes of TCP connections that carry one protocol only, and the port number that is meant where none is given."""

_HERE = frozenset({"localhost", "127.0.0.1", "::1"})


def scheme_of(port: str) -> str:
    """Return the scheme of a URL, nothing for the name of a port of this machine."""
    return port.split("://", 1)[0].lower() if "://" in port else ""


def tcp_place(url: str) -> tuple[str, int]:
    """Return host and port number of a URL; 0, where nobody ever listens, without one. Raises ValueError."""
    parts = urlsplit(url)
    return parts.hostname or "", parts.port or ONE_PROTOCOL.get(parts.scheme, 0)


def same_port(one: str, other: str) -> bool:
    """Whether two ports, as `open_bus` takes them, are the same; an empty name is none."""
    return bool(one and other) and (one == other or _place(one) == _place(other))


def _place(port: str) -> object:
    if "://" not in port:
        return _device(port) or os.path.normcase(os.path.realpath(port.removeprefix("\\\\.\\")))
    try:
        host, number = tcp_place(port)
    except ValueError:
        return port
    # A server has one line behind a number, whichever way its bytes are carried.
    host = host.rstrip(".")
    return ("here" if host.removeprefix("::ffff:") in _HERE else host, number)


def _device(port: str) -> int:
    """Return the number of a device, which each of its nodes has, wherever it is mounted; 0 for anything else."""
    try:
        found = os.stat(port)  # noqa: PTH116 - a name that is no path on some systems
    except (OSError, ValueError):
        return 0
    return found.st_rdev if stat.S_ISCHR(found.st_mode) else 0


_BY_ID = Path("/dev/serial/by-id")


def stable_name(url: str, by_id: Path = _BY_ID) -> str:
    """Return the link in this folder that leads to the port; the name itself where there is none.

    A name that is a link already, and a URL, stay as they are: they were chosen.
    """
    if "://" in url:
        return url
    try:
        if Path(url).is_symlink():
            return url
        port = Path(url).resolve(strict=True)
        # A link of an adapter that has gone leads to a name that nothing has, and so to no port.
        return min((str(link) for link in by_id.iterdir() if link.resolve() == port), default=url)
    except (OSError, ValueError):
        # No such folder, or no such port.
        return url


# Linux, Documentation/admin-guide/devices.txt: the far ends of pseudo-terminals.
_LINUX_MAJORS = range(136, 144)
_NAMES = re.compile(r"/dev/(pts/\d+|ttys\d+|tty[p-zP-T][0-9a-f])")


def is_pseudo(descriptor: int) -> bool:
    """Whether this open terminal is the far end of a pseudo-terminal."""
    if sys.platform == "linux":
        return os.major(os.fstat(descriptor).st_rdev) in _LINUX_MAJORS
    try:
        return _NAMES.fullmatch(os.ttyname(descriptor)) is not None
    except OSError:
        return False
