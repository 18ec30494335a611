"""Arguments and options that several commands have, declared once."""

from __future__ import annotations

from typing import Annotated

import typer

from drivecomm.errors import UsageError

Json = Annotated[bool, typer.Option("--json", help="One JSON object per line.")]
Drive = Annotated[
    str,
    typer.Argument(
        metavar="DRIVE", help="PROTOCOL:ADDRESS or a name from the plant file; ,name=value options may follow it."
    ),
]
Model = Annotated[str | None, typer.Option("--model", "-m", help="Model name, or a .toml file.")]
Type = Annotated[str | None, typer.Option("--type", "-t", help="Data type, as the protocol's manual calls it.")]
VerbOption = Annotated[
    list[str] | None,
    typer.Option("--option", "-o", metavar="NAME=VALUE", help="Option of this protocol's read or write."),
]
OnLinkLoss = Annotated[
    str | None,
    typer.Option(
        "--link-loss",
        metavar="POLICY",
        help="If communication is lost: hold, ramp, coast or trip. Default: as in the plant file.",
    ),
]
Watchdog = Annotated[
    str | None, typer.Option("--watchdog", metavar="SECONDS", help="Timeout of the drive's watchdog. Default: 5.")
]
ProtocolOption = Annotated[
    list[str] | None, typer.Option("--option", "-o", metavar="NAME=VALUE", help="Protocol option, such as pnu_bits=11.")
]
OnlyProtocols = Annotated[list[str] | None, typer.Option("--protocol", help="Only this protocol; repeatable.")]
Addresses = Annotated[str | None, typer.Option("--addresses", "-a", help="Such as 1-31 or 1,5,7-9.")]


def addresses_of(text: str) -> list[int]:
    """Return the addresses of `1-31` or `1,5,7-9`, in order. Raises UsageError."""
    chosen: list[int] = []
    for part in text.split(","):
        first, dash, last = (word.strip() for word in part.partition("-"))
        if not text.isascii() or not first.isdecimal() or (dash and not last.isdecimal()):
            raise UsageError(f"{text!r} is not a list of addresses; write 1-31 or 1,5,7-9")
        chosen += range(int(first), int(last or first) + 1)
    return chosen
