"""Connection limits of the doors: the limits of the system, less the needs of lines, files and stops."""

from __future__ import annotations

import sys
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, runtime_checkable

if TYPE_CHECKING:
    from collections.abc import Sequence

OF_LINE = 8
"""Descriptors of one line: its port and lock, its alarm and wake-up sockets, and a second port while it is reopened."""
OF_DOOR = 8
"""Descriptors of one door besides its clients: its event loop, its listening socket, or its connection to a broker."""
OF_SERVER = 64
"""Descriptors of everything else: streams, core, audit, history and its readers, log, files, webhooks, spare ones."""

_LEAST = 8
"""Connections that each door gets even if the limits of the system are too low for all doors."""
_MEMORY_OF_CONNECTION = 128 * 1024
"""Bytes that a connection needs at most, with a request's body and an unread response."""
_SHARE_OF_MEMORY = 4
"""Connections take up to 1/N of the memory."""
_CGROUPS = Path("/sys/fs/cgroup")
_UNLIMITED = 2**60
"""Limits from here on count as unlimited: control groups of version 1 report a number near 2**63 for no limit."""


@dataclass(frozen=True, slots=True)
class Bounds:
    """Limits on the connections of a door: in total, and from one address."""

    most: int
    of_address: int

    def within(self, most: int) -> Bounds:
        """Return bounds of at most `most` connections; the limit of one address shrinks in proportion."""
        if most >= self.most:
            return self
        return Bounds(most, max(1, self.of_address * most // self.most))


LOCAL_BOUNDS = Bounds(256, 256)
"""Bounds of the door for programs on the same machine; reserved before network doors get their share."""


@runtime_checkable
class TakesConnections(Protocol):
    """A door whose clients use descriptors.

    connections: the requested bounds; the server replaces them with the granted bounds.
    """

    connections: Bounds


@dataclass(frozen=True, slots=True)
class SystemLimits:
    """Resources that the system gives to this process. descriptors, memory (bytes): None if unlimited or unknown."""

    descriptors: int | None = None
    memory: int | None = None


def share_connections(
    system: SystemLimits, wishes: Sequence[Bounds], *, lines: int, doors: int
) -> tuple[Bounds, list[Bounds]]:
    """Return the bounds of the local door, and those of the network doors in the order of their wishes.

    lines, doors: their numbers; doors without clients count, too. A door that wishes for less than an equal share
    leaves the rest to the others.
    """
    if system.descriptors is None and system.memory is None:
        return LOCAL_BOUNDS, list(wishes)
    left = _UNLIMITED
    if system.descriptors is not None:
        left = system.descriptors - OF_SERVER - OF_LINE * lines - OF_DOOR * (doors + 1)
    if system.memory is not None:
        left = min(left, system.memory // _SHARE_OF_MEMORY // _MEMORY_OF_CONNECTION)
    local = LOCAL_BOUNDS.within(max(_LEAST, left // 8))
    left -= local.most
    shares: dict[int, Bounds] = {}
    for place in sorted(range(len(wishes)), key=lambda place: wishes[place].most):
        shares[place] = wishes[place].within(max(_LEAST, left // (len(wishes) - len(shares))))
        left -= shares[place].most
    return local, [shares[place] for place in range(len(wishes))]


def needed_descriptors(wishes: Sequence[Bounds], *, lines: int, doors: int) -> int:
    """Return the number of descriptors with which every door gets the bounds it wishes for."""
    clients = LOCAL_BOUNDS.most + sum(each.most for each in wishes)
    # The local door gets one eighth of what remains after the fixed needs.
    return OF_SERVER + OF_LINE * lines + OF_DOOR * (doors + 1) + max(clients, 8 * LOCAL_BOUNDS.most)


def system_limits(descriptors: int) -> SystemLimits:
    """Raise the limit of open files towards `descriptors` as far as the system permits; return the limits in force."""
    return SystemLimits(_raised(descriptors), memory_limit())


def _raised(descriptors: int) -> int | None:
    if sys.platform == "win32":
        return None
    import resource

    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft == resource.RLIM_INFINITY:
        return None
    wanted = descriptors if hard == resource.RLIM_INFINITY else min(descriptors, hard)
    if wanted > soft:
        with suppress(OSError, ValueError):
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
    return resource.getrlimit(resource.RLIMIT_NOFILE)[0]


def memory_limit(groups: Path = Path("/proc/self/cgroup"), mounted: Path = _CGROUPS) -> int | None:
    """Return the memory limit of this process's control groups in bytes, or None without such a limit."""
    try:
        lines = groups.read_text().splitlines()
    except OSError:
        return None
    found = []
    for line in lines:
        _, controllers, path = line.split(":", 2)
        if controllers and "memory" not in controllers.split(","):
            continue
        root, name = (mounted / "memory", "memory.limit_in_bytes") if controllers else (mounted, "memory.max")
        inner = root / path.strip("/")
        # In a container the path is that of the host, but the mounted tree is that of our own group.
        for folder in (inner, *inner.parents):
            if folder.is_relative_to(root):
                with suppress(OSError, ValueError):
                    found.append(int((folder / name).read_text()))
    limit = min(found, default=_UNLIMITED)
    return limit if limit < _UNLIMITED else None
