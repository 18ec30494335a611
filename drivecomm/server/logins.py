"""Authentication of callers from doors other than the local one: by a token, or by a password for a while.

Wrong passwords delay further attempts. A token never waits, so guessing cannot keep a user from stopping a motor.
"""

from __future__ import annotations

import asyncio
import hashlib
import secrets
import time
from dataclasses import dataclass, replace
from threading import Lock
from typing import TYPE_CHECKING

from drivecomm.errors import FileFormatError, NotAllowedError
from drivecomm.line import result_of
from drivecomm.server.callers import Caller
from drivecomm.server.credentials import new_token, password_fits, password_hash, token_hash
from drivecomm.server.users import read_users

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from drivecomm.server.users import User

LOGGED_IN_S = 8 * 3600.0
MOST_LOGINS = 1000
FREE_FAILURES = 5
"""Number of wrong passwords in a row without a delay."""
LONGEST_WAIT_S = 60.0
_FORGOTTEN_S = 900.0
_LOOKED_AT_S = 1.0
_MOST_AT_ONCE = 4
_BUCKETS = 1024


@dataclass(frozen=True, slots=True, kw_only=True)
class Login:
    """A token that is valid for a while. until_s: in seconds since 1970."""

    token: str
    until_s: float


@dataclass(frozen=True, slots=True)
class _LoggedIn:
    user: str
    password: str
    until: float


class Users:
    """The users of a users file, which can be read again when it has changed. May be used from several threads.

    tell: called with a sentence when the file can no longer be read, so that the users read before stay valid; and when
    it can be read again. clock: a monotonic clock. Raises FileFormatError.
    """

    def __init__(
        self, file: Path, tell: Callable[[str], None] = lambda _: None, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._file, self._tell, self._clock = file, tell, clock
        self._lock = Lock()
        self._hashing = Lock()
        self._logins: dict[str, _LoggedIn] = {}
        self._failures: dict[int, tuple[int, float]] = {}
        self._checked = 0
        self._nobodys = password_hash(new_token())
        self._salt = secrets.token_bytes(16)
        self._seen, self._looked = self._look(), clock()
        self._broken = False
        self._users = {user.name: user for user in read_users(file)}

    def caller(self, token: str, door: str) -> Caller:
        """Return the user with this token, which may be the user's own or that of a login.

        Raises NotAllowedError if the token is unknown.
        """
        shown = token_hash(token)
        with self._lock:
            self._read_again()
            found = None
            for user in self._users.values():
                # All tokens are compared, so that timing does not reveal how similar a guess is.
                if user.token and secrets.compare_digest(shown, user.token):
                    found = user
            found = found or self._logged_in(shown)
        if found is None:
            raise NotAllowedError("this token is not known, or no longer valid; log in again, or use another token")
        return Caller(name=found.name, role=found.role, door=door)

    async def log_in(self, name: str, password: str) -> Login:
        """Return a token for a user with the right password. Raises NotAllowedError."""
        with self._lock:
            self._read_again()
            bucket = self._bucket(name)
            self._must_not_wait(bucket)
            if self._checked >= _MOST_AT_ONCE:
                raise NotAllowedError("too many logins at this moment; try again")
            # Counted before the check, so that parallel attempts get no more guesses than sequential ones.
            self._failures[bucket] = self._failures.get(bucket, (0, 0.0))[0] + 1, self._clock()
            user = self._users.get(name)
            known = user.password if user else ""
            self._checked += 1
        fits = await result_of(asyncio.ensure_future(asyncio.to_thread(self._check, password, known)))
        if user is None or not fits:
            raise NotAllowedError("the name or the password is wrong")
        with self._lock:
            self._failures.pop(bucket, None)
            return self._logged(user)

    def renew(self, token: str) -> Login:
        """Extend a login. Raises NotAllowedError if it has expired."""
        with self._lock:
            self._read_again()
            shown = token_hash(token)
            if self._logged_in(shown) is None:
                raise NotAllowedError("this login has expired; log in again")
            self._logins[shown] = replace(self._logins[shown], until=self._clock() + LOGGED_IN_S)
        return Login(token=token, until_s=time.time() + LOGGED_IN_S)

    def log_out(self, token: str) -> None:
        """End a login; its token is invalid from now on."""
        with self._lock:
            self._logins.pop(token_hash(token), None)

    def _check(self, password: str, known: str) -> bool:
        try:
            with self._hashing:
                # Unknown names take the same time, so timing reveals nothing.
                return password_fits(password, known or self._nobodys) and bool(known)
        finally:
            with self._lock:
                self._checked -= 1

    def _logged(self, user: User) -> Login:
        now = self._clock()
        self._logins = {token: each for token, each in self._logins.items() if now < each.until}
        if len(self._logins) >= MOST_LOGINS:
            of_user = [each.user for each in self._logins.values()]
            most = max(set(of_user), key=of_user.count)
            del self._logins[next(token for token, each in self._logins.items() if each.user == most)]
        token = new_token()
        self._logins[token_hash(token)] = _LoggedIn(user.name, user.password, now + LOGGED_IN_S)
        return Login(token=token, until_s=time.time() + LOGGED_IN_S)

    def _logged_in(self, shown: str) -> User | None:
        login = self._logins.get(shown)
        if login is None or self._clock() >= login.until:
            return None
        user = self._users.get(login.user)
        # A removed user, or one with a new password, is no longer logged in.
        return user if user is not None and user.password == login.password else None

    def _bucket(self, name: str) -> int:
        """Return the counter for failures of a name.

        Many names share each counter, so that names cannot fill memory.
        """
        digest = hashlib.sha256(self._salt + name.encode(errors="replace")).digest()
        return int.from_bytes(digest[:4], "big") % _BUCKETS

    def _must_not_wait(self, bucket: int) -> None:
        failed, last = self._failures.get(bucket, (0, 0.0))
        passed = self._clock() - last
        if passed > _FORGOTTEN_S:
            self._failures.pop(bucket, None)
        elif failed >= FREE_FAILURES:
            wait_s = min(2.0 ** min(failed - FREE_FAILURES, 10), LONGEST_WAIT_S) - passed
            if wait_s > 0:
                raise NotAllowedError(
                    f"too many wrong passwords for this name; try again in {max(wait_s, 1):.0f} s, or use a token"
                )

    def _read_again(self) -> None:
        now = self._clock()
        if now - self._looked < _LOOKED_AT_S:
            return
        self._looked = now
        seen = self._look()
        if seen == self._seen:
            return
        self._seen = seen
        try:
            self._users = {user.name: user for user in read_users(self._file)}
        except FileFormatError as error:
            self._broken = True
            self._tell(f"{error}; the users read before stay valid")
        else:
            if self._broken:
                self._tell(f"{self._file}: can be read again")
            self._broken = False

    def _look(self) -> tuple[int, ...]:
        try:
            found = self._file.stat()
        except OSError:
            return ()
        return found.st_mtime_ns, found.st_ctime_ns, found.st_size, found.st_ino, found.st_mode, found.st_uid
