"""Whether two names mean the same port: a file and its link, one server called in two ways."""

from __future__ import annotations

import os
from urllib.parse import urlsplit

_HERE = frozenset({"localhost", "127.0.0.1", "::1"})


def same_port(one: str, other: str) -> bool:
    """Whether two ports, as `open_bus` takes them, are the same; an empty name is none."""
    return bool(one and other) and (one == other or _place(one) == _place(other))


def _place(port: str) -> object:
    if "://" not in port:
        return os.path.normcase(os.path.realpath(port.removeprefix("\\\\.\\")))
    try:
        parts = urlsplit(port)
        host, number = (parts.hostname or "").rstrip("."), parts.port
    except ValueError:
        return port
    # A server has one line behind a number, whichever way its bytes are carried.
    return ("here" if host in _HERE else host, number)
