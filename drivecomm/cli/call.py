"""The call command: functions that only one protocol has."""

from __future__ import annotations

from typing import Annotated

import typer

from drivecomm.cli.line_options import LineOptions
from drivecomm.cli.one_drive import done
from drivecomm.cli.options import Drive, Model
from drivecomm.protocol import parse_options


def call(
    drive: Drive,
    verb: Annotated[str, typer.Argument(help="A function of this protocol; an unknown name lists them all.")],
    line: LineOptions,
    arguments: Annotated[
        list[str] | None, typer.Argument(metavar="NAME=VALUE...", help="Its arguments, such as number=2.")
    ] = None,
    model: Model = None,
) -> int:
    """Call a function that only this protocol has, such as jog."""
    with line.drive(drive, model) as (one, name):
        result = one.call(verb, **parse_options(arguments or []))
        done(name, line, verb, result=result)
    return 0
