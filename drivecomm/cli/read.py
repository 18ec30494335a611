"""The read command."""

from __future__ import annotations

from typing import Annotated

import typer

from drivecomm.cli.line_options import LineOptions
from drivecomm.cli.one_drive import show_reading, verb_options
from drivecomm.cli.options import Drive, Model, Type, VerbOption
from drivecomm.cli.output import complain
from drivecomm.errors import DriveCommError, LinkError


def read(
    drive: Drive,
    parameters: Annotated[list[str], typer.Argument(metavar="PARAM...", help="Addresses, or names from the model.")],
    line: LineOptions,
    model: Model = None,
    type: Type = None,
    option: VerbOption = None,
) -> int:
    """Read parameters. If one cannot be read, the others still are."""
    options = verb_options(type, option)
    code = 0
    reached, name = line.reaching(drive)
    with reached.drive_at(name, model) as one:
        for parameter in parameters:
            try:
                reading = one.read(parameter, **options)
            except LinkError:
                raise
            except DriveCommError as error:
                error.about = {**name.labels, "parameter": parameter}
                complain(error, as_json=line.json, where=f"{reached.named_port}, {name.name}, {parameter}")
                code = code or error.exit_code
            else:
                show_reading(name, parameter, reading, as_json=line.json)
    return code
