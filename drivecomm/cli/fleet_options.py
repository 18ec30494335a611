"""What commands on a whole fleet are given: its broker, and the record of its plants."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

import click

from drivecomm.cli.values import FILE
from drivecomm.errors import UsageError
from drivecomm.tomlfile import Table

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from drivecomm.server.broker import BrokerSettings

F = TypeVar("F", bound="Callable[..., Any]")

record_option = click.option(
    "--from",
    "record",
    required=True,
    metavar="RECORD",
    help="Show from this record: postgresql://USER@HOST/DATABASE or a file, as fleet record --to has it.",
)


def broker_options(command: F) -> F:
    """Add the options of a broker, in the order of the help."""
    for option in reversed(
        (
            click.option("--prefix", metavar="TOPIC", default="drivecomm", help="The topic above all plants."),
            click.option("--user", metavar="NAME", help="Who this is to the broker."),
            click.option("--password-file", type=FILE, help="A file with the password in its first line."),
            click.option("--authority", type=FILE, help="Who has signed the broker's certificate."),
            click.option("--insecure", is_flag=True, help="Allow a broker or database on another machine without TLS."),
        )
    ):
        command = option(command)
    return command


def broker_of(
    broker: str, user: str | None, password_file: Path | None, authority: Path | None, *, insecure: bool
) -> BrokerSettings:
    """Return the broker that the options describe. Raises UsageError."""
    from drivecomm.server.broker import broker_settings

    given = {"broker": broker, "user": user, "insecure": insecure or None}
    for key, path in (("password_file", password_file), ("authority", authority)):
        given[key] = None if path is None else str(path.absolute())
    said = {key: each for key, each in given.items() if each is not None}
    return broker_settings(Table(said, "command line"), said)


def checked_prefix(prefix: str) -> str:
    """Return the levels above the plants' names. Raises UsageError for what is no topic."""
    if not prefix or set(prefix) & set("+#"):
        raise UsageError(f"invalid --prefix {prefix!r}; give a topic without + and #")
    return prefix.strip("/")
