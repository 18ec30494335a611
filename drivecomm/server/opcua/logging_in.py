"""Login: a user of the plant with name and password or with name and token, or anonymous read access if permitted."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

from asyncua import ua
from asyncua.common.utils import ServiceError

from drivecomm.errors import NotAllowedError
from drivecomm.server import ANONYMOUS, Caller, Role

if TYPE_CHECKING:
    from asyncua.server.internal_session import InternalSession

    from drivecomm.server import KnownUsers

_LONGEST = 1024
"""Maximum characters of a name or a password."""

_RENEWED_S = 3600.0
"""Remaining seconds at which a login is renewed, so that an active user is not logged out."""


class LoggingIn:
    """Authentication. users: users of the plant, None without users. anonymous: whether anonymous clients may read."""

    def __init__(self, users: KnownUsers | None, door: str, *, anonymous: bool) -> None:
        self._users, self._door, self._anonymous = users, door, anonymous
        self._until: dict[str, float] = {}

    @property
    def tokens(self) -> tuple[type, ...]:
        """Types of accepted identity tokens."""
        named = (ua.UserNameIdentityToken,) if self._users is not None else ()
        return (ua.AnonymousIdentityToken, *named) if self._anonymous else named

    async def recognise(self, session: InternalSession, token: Any) -> tuple[Caller, str]:
        """Return the caller and the caller's token, "" if anonymous. Raises ServiceError."""
        if token is None or isinstance(token, ua.AnonymousIdentityToken | ua.ExtensionObject):
            if not self._anonymous:
                raise ServiceError(ua.StatusCodes.BadIdentityTokenRejected)
            return Caller(name=ANONYMOUS, role=Role.VIEW, door=self._door), ""
        if self._users is None or not isinstance(token, ua.UserNameIdentityToken):
            raise ServiceError(ua.StatusCodes.BadIdentityTokenRejected)
        try:
            name, password = session.iserver.decrypt_user_token(session, token)
        except Exception as error:
            raise ServiceError(ua.StatusCodes.BadIdentityTokenInvalid) from error
        if not (isinstance(name, str) and isinstance(password, str)) or max(len(name), len(password)) > _LONGEST:
            raise ServiceError(ua.StatusCodes.BadIdentityTokenInvalid)
        return await self._named(self._users, name, password)

    async def _named(self, users: KnownUsers, name: str, password: str) -> tuple[Caller, str]:
        try:
            # A user's own token is never rate-limited: password guessing by others must not delay a stop.
            caller = users.caller(password, self._door)
            if caller.name == name:
                return caller, password
        except NotAllowedError:
            pass
        try:
            logged_in = await users.log_in(name, password)
            self._until[logged_in.token] = logged_in.until_s
            return users.caller(logged_in.token, self._door), logged_in.token
        except NotAllowedError:
            raise ServiceError(ua.StatusCodes.BadUserAccessDenied) from None

    def still(self, caller: Caller, token: str) -> Caller:
        """Return the caller with the present role. Raises NotAllowedError if the token has become invalid."""
        if not token:
            return caller
        if self._users is None:
            raise NotAllowedError("the plant no longer has users")
        until = self._until.get(token)
        if until is not None and until - time.time() < _RENEWED_S:
            self._until[token] = self._users.renew(token).until_s
        return self._users.caller(token, self._door)

    def log_out(self, token: str) -> None:
        """End the login of a session."""
        if self._users is not None and self._until.pop(token, None) is not None:
            self._users.log_out(token)
