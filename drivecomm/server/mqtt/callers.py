"""Callers over a broker, which does not reveal the publisher: users identified by token, or one caller for all."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from drivecomm.errors import NotAllowedError
from drivecomm.server import ANONYMOUS, Caller, Role

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.server import KnownUsers

EVERYBODY = "(broker)"
"""Name of callers without a token if the plant file gives them a role; no user can have this name."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BrokerCallers:
    """Callers identified by token. role: role of callers without a token, None if they are refused."""

    users: KnownUsers | None
    door: str
    role: Role | None

    @property
    def listens(self) -> bool:
        """Whether any caller may command."""
        return self.users is not None or self.role is not None

    @property
    def unknown(self) -> Caller:
        """The unidentified caller, for audit records."""
        return Caller(name=ANONYMOUS, role=Role.NOBODY, door=self.door)

    @property
    def everybody(self) -> Caller:
        """The caller of all messages without a token."""
        return self.unknown if self.role is None else Caller(name=EVERYBODY, role=self.role, door=self.door)

    def of(self, content: Mapping[str, Any]) -> Caller:
        """Return the caller of a message.

        Raises NotAllowedError for a wrong token, or for a missing token if the plant file gives no role.
        """
        token = content.get("token")
        if token is None:
            if self.role is None:
                raise NotAllowedError("only users may command here; send your token in the field token")
            return self.everybody
        if self.users is None:
            raise NotAllowedError("the plant has no users; leave the token out")
        return self.users.caller(token, self.door)
