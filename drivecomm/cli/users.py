"""The users commands: who may reach a served plant over a network."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from drivecomm.cli.options import Json
from drivecomm.cli.output import emit, print_columns, say, tell
from drivecomm.errors import UsageError, meant
from drivecomm.server import ROLES, User, add_user, new_token, password_hash, read_users, remove_user, token_hash

_Name = Annotated[str, typer.Argument(metavar="NAME", help="What the user is called.")]
_File = Annotated[Path, typer.Option("--file", metavar="FILE", help="The file that the plant file names as users.")]


def add(
    name: _Name,
    role: Annotated[str, typer.Option("--role", metavar="ROLE", help="view, operate or commission.")],
    password: Annotated[
        bool, typer.Option("--password", help="Ask for a password, too, or read it from a pipe.")
    ] = False,
    file: _File = Path("users.toml"),
    json: Json = False,
) -> None:
    """Add a user, and print the token by which the user comes in; it is shown this once."""
    if role not in ROLES:
        raise UsageError(f"unknown role {role!r}; {meant(role, ROLES, 'use')}")
    token = new_token()
    known = password_hash(_asked()) if password else ""
    add_user(file, User(name=name, role=ROLES[role], token=token_hash(token), password=known))
    if json:
        emit(name=name, role=role, file=str(file), token=token)
        return
    say(f"{name} may {role} now, says {file}. The token, which is shown this once:")
    say(token)


def list_users(file: _File = Path("users.toml"), json: Json = False) -> None:
    """List the users with their roles, and by what they are recognised."""
    rows = []
    for user in read_users(file):
        role = user.role.name.lower()
        if json:
            emit(name=user.name, role=role, token=bool(user.token), password=bool(user.password))
        rows.append((user.name, role, " and ".join(what for what in ("token", "password") if getattr(user, what))))
    if not json:
        print_columns(rows)


def remove(name: _Name, file: _File = Path("users.toml"), json: Json = False) -> None:
    """Remove a user; a running server lets them in no longer."""
    remove_user(file, name)
    tell(f"{name} removed from {file}", as_json=json, name=name, file=str(file))


def _asked() -> str:
    if not sys.stdin.isatty():
        return sys.stdin.readline().rstrip("\r\n")
    asked: str = typer.prompt("Password", hide_input=True, confirmation_prompt=True, err=True)
    return asked
