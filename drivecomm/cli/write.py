"""The write command."""

from __future__ import annotations

from typing import Annotated

import typer

from drivecomm.cli.line_options import LineOptions
from drivecomm.cli.one_drive import show_reading, verb_options
from drivecomm.cli.options import Drive, Model, Type, VerbOption
from drivecomm.cli.output import emit, say


def write(
    drive: Drive,
    parameter: Annotated[str, typer.Argument(metavar="PARAM", help="Address, or name from the model.")],
    value: Annotated[str, typer.Argument(help="In physical units where the model has the scale.")],
    line: LineOptions,
    store: Annotated[bool, typer.Option("--store", help="Store it in EEPROM, so that it survives power-off.")] = False,
    read_back: Annotated[
        bool, typer.Option("--read-back", help="Read it back; exit code 5 when the drive holds another value.")
    ] = False,
    model: Model = None,
    type: Type = None,
    option: VerbOption = None,
) -> int:
    """Write a parameter: to RAM, or with --store to EEPROM, where the protocol distinguishes them."""
    with line.drive(drive, model) as (one, name):
        write = one.write_and_read if read_back else one.write
        reading = write(parameter, value, store=store, **verb_options(type, option))
        if reading is not None:
            show_reading(name, parameter, reading, as_json=line.json)
        elif line.json:
            emit(**name.labels, parameter=parameter, written=value, stored=store)
        else:
            say(f"{name.name}  {parameter} = {value}  written{' and stored' if store else ''}")
    return 0
