"""Commands `users ...`: the users with access to a served plant over a network."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from drivecomm.cli import options
from drivecomm.cli.commands import CliCommand
from drivecomm.cli.output import emit, print_columns, say, tell
from drivecomm.cli.values import FILE
from drivecomm.errors import UsageError, suggestion
from drivecomm.server import ROLES, User, add_user, new_token, password_hash, read_users, remove_user, token_hash

_name_argument = click.argument("name", help="Name of the user.")
_file_option = click.option(
    "--file", type=FILE, default=Path("users.toml"), help="The file that the plant file names as users."
)


@click.command(cls=CliCommand)
@_name_argument
@click.option("--role", metavar="ROLE", required=True, help="view, operate or commission.")
@click.option("--password", is_flag=True, help="Also prompt for a password, or read it from a pipe.")
@_file_option
@options.json
def add(*, name: str, role: str, password: bool, file: Path, json: bool) -> None:
    """Add a user, and print the user's access token; it is shown only once."""
    if role not in ROLES:
        raise UsageError(f"unknown role {role!r}; {suggestion(role, ROLES, 'use')}")
    token = new_token()
    known = password_hash(_asked()) if password else ""
    add_user(file, User(name=name, role=ROLES[role], token=token_hash(token), password=known))
    if json:
        emit(name=name, role=role, file=str(file), token=token)
        return
    say(f"{name} has the role {role} in {file} now. The access token, which is shown only once:")
    say(token)


@click.command("list", cls=CliCommand)
@_file_option
@options.json
def list_users(*, file: Path, json: bool) -> None:
    """List the users with their roles and kinds of credentials."""
    rows = []
    for user in read_users(file):
        role = user.role.name.lower()
        if json:
            emit(name=user.name, role=role, token=bool(user.token), password=bool(user.password))
        rows.append((user.name, role, " and ".join(what for what in ("token", "password") if getattr(user, what))))
    if not json:
        print_columns(rows)


@click.command(cls=CliCommand)
@_name_argument
@_file_option
@options.json
def remove(*, name: str, file: Path, json: bool) -> None:
    """Remove a user; a running server refuses them from then on."""
    remove_user(file, name)
    tell(f"{name} removed from {file}", as_json=json, name=name, file=str(file))


def _asked() -> str:
    if not sys.stdin.isatty():
        return sys.stdin.readline().rstrip("\r\n")
    asked: str = click.prompt("Password", hide_input=True, confirmation_prompt=True, err=True)
    return asked
