"""The file of the users of doors other than the local one.

  [[user]]
  name = "anna"
  role = "operate"                # view, operate or commission
  token = "sha256:..."            # hash of her token; or password = "scrypt:...", or both

`drivecomm users` writes it. Only its owner can read or write it.
"""

from __future__ import annotations

import os
import re
import stat
from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivecomm.errors import FileFormatError, UsageError, suggestion
from drivecomm.server.callers import ANONYMOUS, Role
from drivecomm.server.credentials import is_password_hash, is_token_hash
from drivecomm.tomlfile import TABLES, TEXT, parse_toml, read_text_file, read_toml, toml_line, write_atomically

if TYPE_CHECKING:
    from pathlib import Path

    from drivecomm.tomlfile import TomlTable

ROLES = {role.name.lower(): role for role in Role if role is not Role.NOBODY}
_USER = {"name": TEXT, "role": TEXT, "token": TEXT, "password": TEXT}
_NAME = re.compile(r"[^\W_][\w.@+-]{0,63}")
_HEADER = re.compile(r"\s*\[")


@dataclass(frozen=True, slots=True, kw_only=True)
class User:
    """A user of network doors. token, password: hashes, empty if there is none."""

    name: str
    role: Role
    token: str = ""
    password: str = ""

    def __post_init__(self) -> None:
        if not _NAME.fullmatch(self.name):
            raise UsageError(f"{self.name!r:.80} cannot be a user's name; use letters, digits and . _ @ + -")
        if self.name == ANONYMOUS:
            raise UsageError(f"{ANONYMOUS} is reserved for callers without a login; choose another user name")
        if not self.token and not self.password:
            raise UsageError(f"{self.name} has neither a token nor a password; make one with drivecomm users add")
        if self.token and not is_token_hash(self.token):
            raise UsageError(f"the token of {self.name} is not sha256:...; make one with drivecomm users add")
        if self.password and not is_password_hash(self.password):
            raise UsageError(f"the password of {self.name} is not scrypt:...; make one with drivecomm users add")


def read_users(file: Path) -> tuple[User, ...]:
    """Return the users of a file. Raises FileFormatError with file, line, entry and reason, never with a secret."""
    _must_be_private(file)
    top = read_toml(file, "a file of users")
    top.take({"user": TABLES})
    users: dict[str, User] = {}
    for table in top.tables("user"):
        user = _user(table)
        if user.name in users:
            raise table.error(f"{user.name} is listed twice; remove one of the two")
        users[user.name] = user
    return tuple(users.values())


def add_user(file: Path, user: User) -> None:
    """Add a user to the file, which is created if missing; other text in it stays.

    Raises UsageError for a name that exists already, FileFormatError for a file that cannot be read or written.
    """
    there = file.exists()
    if there and user.name in (each.name for each in read_users(file)):
        raise UsageError(f"{file} has a user {user.name} already; remove that one first with drivecomm users remove")
    said = {"name": user.name, "role": user.role.name.lower(), "token": user.token, "password": user.password}
    entry = "".join(f"{toml_line(key, value)}\n" for key, value in said.items() if value)
    before = read_text_file(file, "a file of users") if there else ""
    if before and not before.endswith("\n"):
        before += "\n"
    write_atomically(file, f"{before}{chr(10) if before else ''}[[user]]\n{entry}", mode=None if there else 0o600)


def remove_user(file: Path, name: str) -> None:
    """Remove a user from the file; other text in it stays.

    Raises UsageError for an unknown name, FileFormatError for a file that cannot be read or written.
    """
    names = [each.name for each in read_users(file)]
    if name not in names:
        raise UsageError(f"{file} has no user {name!r:.80}; {suggestion(name, names, 'it has')}")
    text = read_text_file(file, "a file of users")
    lines = text.splitlines(keepends=True)
    headers = [place for place, line in enumerate(lines) if _HEADER.match(line)]
    number = names.index(name)
    left = parse_toml(text, str(file))["user"]
    del left[number]
    if number < len(headers):
        del lines[headers[number] : headers[number + 1] if number + 1 < len(headers) else len(lines)]
    if parse_toml("".join(lines), str(file)).get("user", []) != left:
        raise FileFormatError(f"{file}: {name} cannot be removed from what is written there; remove the entry by hand")
    write_atomically(file, "".join(lines))


def _user(table: TomlTable) -> User:
    for key in ("token", "password"):
        if not isinstance(table.content.get(key, ""), str):
            raise table.error(f"{key} is a text in quotes, as drivecomm users add writes it", key)
    given = table.take(_USER, "name", "role")
    if given["role"] not in ROLES:
        raise table.error(f"unknown role {given['role']!r:.80}; {suggestion(given['role'], ROLES, 'use')}", "role")
    try:
        return User(**{**given, "role": ROLES[given["role"]]})
    except UsageError as error:
        raise table.error(str(error)) from error


def _must_be_private(file: Path) -> None:
    """Raise FileFormatError if other users of the system could read or write the file."""
    if os.name != "posix":
        return
    try:
        found = file.stat()
    except OSError:
        # The read that follows reports the reason.
        return
    # A file that root provides for a service may be readable for the group of the service.
    allowed = 0o640 if found.st_uid == 0 else 0o600
    if stat.S_IMODE(found.st_mode) & ~allowed & 0o077:
        raise FileFormatError(f"{file}: others can read or write it; run chmod {allowed:o} {file}")
    if os.geteuid() not in (found.st_uid, 0) and found.st_uid != 0:
        raise FileFormatError(f"{file}: belongs to another user, who can write it; run chown $USER {file}")
