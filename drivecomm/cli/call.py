"""The call command: functions that only one protocol has."""

from __future__ import annotations

from typing import Annotated

import typer

from drivecomm.cli.drive_names import parse_settings
from drivecomm.cli.line_options import LineOptions
from drivecomm.cli.one_drive import done
from drivecomm.cli.options import Drive, Model


def call(
    drive: Drive,
    verb: Annotated[str, typer.Argument(help="A verb that only this protocol has; a wrong one lists them.")],
    line: LineOptions,
    arguments: Annotated[list[str] | None, typer.Argument(metavar="NAME=VALUE...")] = None,
    model: Model = None,
) -> int:
    """Carry out a verb that only this protocol has, such as jog or set_up."""
    with line.drive(drive, model) as (one, name):
        result = one.call(verb, **parse_settings(arguments or []))
        done(name, line, verb, result=result)
    return 0
