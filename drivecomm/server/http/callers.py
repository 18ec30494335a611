"""Identification of the caller of a request: by token, by the user at the other end of a socket, or anonymous."""

from __future__ import annotations

import hmac
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Protocol

from drivecomm.client import may_command, user_of_peer
from drivecomm.errors import NotAllowedError
from drivecomm.server import ANONYMOUS, LOCAL, Caller, Role

if TYPE_CHECKING:
    from starlette.types import Scope

    from drivecomm.server import KnownUsers


class Callers(Protocol):
    """Identification of the callers of a door."""

    def of(self, scope: Scope) -> Caller | None:
        """Return the caller of a request; None if the caller is unknown."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TokenCallers:
    """Callers identified by `Authorization: Bearer TOKEN`. anonymous: role of callers without a token."""

    users: KnownUsers | None
    door: str
    anonymous: Role

    def of(self, scope: Scope) -> Caller | None:
        """Return the caller of a request. A wrong token is rejected and does not count as anonymous."""
        token = bearer(scope)
        if token is None:
            if self.anonymous is Role.NOBODY:
                return None
            return Caller(name=ANONYMOUS, role=self.anonymous, door=self.door)
        if self.users is None:
            return None
        try:
            return self.users.caller(token, self.door)
        except NotAllowedError:
            return None


class SocketCallers:
    """Callers of a unix socket: full rights for root and the user of this process, read access for others."""

    def of(self, scope: Scope) -> Caller | None:
        """Return the caller, with the user name from the operating system."""
        connected = scope["state"]["transport"].get_extra_info("socket")
        uid = user_of_peer(connected)
        if uid is None:
            return None
        role = Role.COMMISSION if may_command(connected) else Role.VIEW
        return Caller(name=_user_name(uid), role=role, door=LOCAL)


@dataclass(frozen=True, slots=True)
class SecretCallers:
    """Callers of the local door on systems without unix sockets: only the owner can read the secret."""

    secret: str

    def of(self, scope: Scope) -> Caller | None:
        """Return the caller; None if the secret is wrong or missing."""
        if hmac.compare_digest((bearer(scope) or "").encode(), self.secret.encode()):
            from getpass import getuser

            return Caller(name=getuser(), role=Role.COMMISSION, door=LOCAL)
        return None


def bearer(scope: Scope) -> str | None:
    """Return the token of a request; None without one. Another scheme than Bearer gives "", which is always wrong."""
    for name, value in scope["headers"]:
        if name == b"authorization":
            scheme, _, token = value.decode("latin-1").partition(" ")
            return token.strip() if scheme.lower() == "bearer" else ""
    return None


@lru_cache(maxsize=256)
def _user_name(uid: int) -> str:
    import pwd

    try:
        return pwd.getpwuid(uid).pw_name
    except KeyError:
        return f"uid {uid}"
