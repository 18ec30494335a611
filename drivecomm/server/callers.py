"""Who asks a server for something, by which door, and what they may do."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

LOCAL = "local"
"""The door for programs of this machine."""

ANONYMOUS = "anonymous"
"""What callers are called who have not said who they are; no user is called so."""


class Role(IntEnum):
    """What somebody may do; each role may also do what those before it may."""

    NOBODY = 0
    VIEW = 1
    """See values, states and events."""
    OPERATE = 2
    """Start, reset and reverse motors, and set references."""
    COMMISSION = 3
    """Write parameters, call what a protocol has of its own, scan and examine lines."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Caller:
    """Who asks.

    name: a user's, or what is known of them. door: by which they came, "local" for programs of this machine that found
    the server's own socket.
    """

    name: str
    role: Role
    door: str

    def __str__(self) -> str:
        return f"{self.name} ({self.door})"

    @property
    def door_kind(self) -> str:
        """The kind of door, with which its name begins: "http" of "http 127.0.0.1:8080"."""
        return self.door.partition(" ")[0]
