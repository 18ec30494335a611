"""Who asks over a broker, which does not tell who has published: users by their tokens, or everybody alike."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from drivecomm.errors import NotAllowedError
from drivecomm.server import ANONYMOUS, Caller, Role

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.server import KnownUsers

EVERYBODY = "(broker)"
"""What callers without a token are called where the plant file gives them a role; no user can be called so."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BrokerCallers:
    """Callers known by tokens. role: of those who send none, None where they are nobody."""

    users: KnownUsers | None
    door: str
    role: Role | None

    @property
    def listens(self) -> bool:
        """Whether anybody could ask for anything."""
        return self.users is not None or self.role is not None

    @property
    def unknown(self) -> Caller:
        """Nobody in particular, for what is written of them."""
        return Caller(name=ANONYMOUS, role=Role.NOBODY, door=self.door)

    @property
    def everybody(self) -> Caller:
        """Whoever sends no token."""
        return self.unknown if self.role is None else Caller(name=EVERYBODY, role=self.role, door=self.door)

    def of(self, content: Mapping[str, Any]) -> Caller:
        """Return who sends this. Raises NotAllowedError for a wrong token, and for none where that is nobody."""
        token = content.get("token")
        if token is None:
            if self.role is None:
                raise NotAllowedError("only users are listened to here; send your token in the field token")
            return self.everybody
        if self.users is None:
            raise NotAllowedError("the plant has no users; leave the token out")
        return self.users.caller(token, self.door)
