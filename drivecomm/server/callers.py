"""Callers of a server: name, role, and the door by which they came."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

LOCAL = "local"
"""The name of the local door, for programs on the same machine."""

ANONYMOUS = "anonymous"
"""The name of callers without a login; no user can have this name."""


class Role(IntEnum):
    """Roles of callers; each role includes the rights of those before it."""

    NOBODY = 0
    VIEW = 1
    """See values, states and events."""
    OPERATE = 2
    """Start, reset and reverse motors, and set references."""
    COMMISSION = 3
    """Write parameters, call protocol-specific methods, scan and examine lines."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Caller:
    """The sender of a request or command.

    name: name of the user, or another identification of the caller. door: the door by which the request came, "local"
    for programs on the same machine that use the server's own socket.
    """

    name: str
    role: Role
    door: str

    def __str__(self) -> str:
        return f"{self.name} ({self.door})"

    @property
    def door_kind(self) -> str:
        """The kind of the door, which is the first word of its name: "http" of "http 127.0.0.1:8080"."""
        return self.door.partition(" ")[0]
