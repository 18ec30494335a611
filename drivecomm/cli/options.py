"""Arguments and options that several commands share."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, Any

import click

from drivecomm.cli.drive_names import known_plant
from drivecomm.errors import DriveCommError, UsageError

if TYPE_CHECKING:
    from drivecomm.plant import Plant


class _Addresses(click.ParamType[list[int]]):
    """Click type of a list of addresses, in order."""

    name = "addresses"

    def convert(self, value: Any, _param: click.Parameter | None, _ctx: click.Context | None) -> list[int]:
        """Return the addresses of `1-31` or `1,5,7-9`. Raises UsageError."""
        text = str(value)
        chosen: list[int] = []
        for part in text.split(","):
            first, dash, last = (word.strip() for word in part.partition("-"))
            if not text.isascii() or not first.isdecimal() or (dash and not last.isdecimal()):
                raise UsageError(f"{text!r} is not a list of addresses; write 1-31 or 1,5,7-9")
            chosen += range(int(first), int(last or first) + 1)
        return chosen


def complete_drive(ctx: click.Context, _param: click.Parameter, begun: str) -> list[str]:
    """Return the drives of the plant whose names begin with this text; empty if the plant cannot be read."""
    known = _plant(ctx)
    return [each.name for each in known.drives if each.name.startswith(begun)] if known else []


def complete_drive_or_group(ctx: click.Context, _param: click.Parameter, begun: str) -> list[str]:
    """Return the drives and then the groups whose names begin with this text."""
    known = _plant(ctx)
    names = [*(each.name for each in known.drives), *known.groups] if known else []
    return [name for name in names if name.startswith(begun)]


def _plant(ctx: click.Context) -> Plant | None:
    with suppress(DriveCommError):
        return known_plant(ctx.params.get("plant"), port_given=False)
    return None


def complete_protocol(_ctx: click.Context, _param: click.Parameter, begun: str) -> list[str]:
    """Return the installed protocols whose names begin with this text."""
    # Imported late, because the completion of a command needs no protocols.
    from drivecomm.protocol import installed

    return [name for name in installed if name.startswith(begun)]


json = click.option("--json", is_flag=True, help="One JSON object per line.")
drive = click.argument(
    "drive",
    shell_complete=complete_drive,
    metavar="DRIVE",
    help="PROTOCOL:ADDRESS or a name from the plant file; ,name=value options may follow it.",
)
model = click.option("--model", "-m", metavar="MODEL", help="Model name, or a .toml file.")
data_type = click.option("--type", "-t", metavar="TYPE", help="Data type, as the protocol's manual calls it.")
verb_option = click.option(
    "--option", "-o", metavar="NAME=VALUE", multiple=True, help="Option of this protocol's read or write."
)
protocol_option = click.option(
    "--option", "-o", metavar="NAME=VALUE", multiple=True, help="Protocol option, such as pnu_bits=11."
)
link_loss = click.option(
    "--link-loss",
    metavar="POLICY",
    help="If communication is lost: hold, ramp, coast or trip. Default: as in the plant file.",
)
watchdog = click.option("--watchdog", metavar="SECONDS", help="Timeout of the drive's watchdog. Default: 5.")
only_protocols = click.option(
    "--protocol",
    shell_complete=complete_protocol,
    metavar="PROTOCOL",
    multiple=True,
    help="Only this protocol, also with drive options: toy,end=1; repeatable.",
)
addresses = click.option("--addresses", "-a", type=_Addresses(), help="Such as 1-31 or 1,5,7-9.")
