"""Options of commands on a fleet: its broker, and the record of its plants."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import wraps
from typing import TYPE_CHECKING, Any

import click

from drivecomm.cli.values import FILE
from drivecomm.errors import UsageError
from drivecomm.tomlfile import TomlTable

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from drivecomm.server.broker import BrokerSettings

record_option = click.option(
    "--from",
    "record",
    required=True,
    metavar="RECORD",
    help="The record to show: postgresql://USER@HOST/DATABASE or a file, as in fleet record --to.",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class BrokerOptions:
    """Connection to a broker, and the topic of its plants. insecure: allow another machine without TLS."""

    prefix: str
    user: str | None
    password_file: Path | None
    authority: Path | None
    insecure: bool

    def broker(self, url: str) -> BrokerSettings:
        """Return the broker settings for a URL. Raises UsageError."""
        from drivecomm.server.broker import broker_settings

        given = {"broker": url, "user": self.user, "insecure": self.insecure or None}
        for key, path in (("password_file", self.password_file), ("authority", self.authority)):
            given[key] = None if path is None else str(path.absolute())
        said = {key: each for key, each in given.items() if each is not None}
        return broker_settings(TomlTable(said, "command line"), said)

    @property
    def above(self) -> str:
        """Topic levels above the names of the plants. Raises UsageError for an invalid topic."""
        if not self.prefix or set(self.prefix) & set("+#"):
            raise UsageError(f"invalid --prefix {self.prefix!r}; give a topic without + and #")
        return self.prefix.strip("/")


def broker_options(command: Callable[..., int]) -> Callable[..., int]:
    """Add the options of a broker, in the order of the help; the command gets them as `reach`."""

    @wraps(command)
    def with_broker(**given: Any) -> int:
        reach = BrokerOptions(**{each.name: given.pop(each.name) for each in fields(BrokerOptions)})
        return command(**given, reach=reach)

    for option in reversed(
        (
            click.option("--prefix", metavar="TOPIC", default="drivecomm", help="The topic above all plants."),
            click.option("--user", metavar="NAME", help="User name at the broker."),
            click.option("--password-file", type=FILE, help="A file with the password in its first line."),
            click.option("--authority", type=FILE, help="Certificate of the authority that signed the broker's."),
            click.option("--insecure", is_flag=True, help="Allow a broker or database on another machine without TLS."),
        )
    ):
        with_broker = option(with_broker)
    return with_broker
