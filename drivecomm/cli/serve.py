"""Command `serve`: one process that owns the lines of a plant and gives other programs access to its drives."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import click

from drivecomm.cli import event_loop, options
from drivecomm.cli.commands import CliCommand
from drivecomm.cli.drive_names import PLANT_FILE, plant_file
from drivecomm.cli.extras import must_have
from drivecomm.cli.output import counted, emit, say, tell
from drivecomm.cli.output_files import force_option, must_be_free
from drivecomm.cli.values import FILE
from drivecomm.errors import UsageError
from drivecomm.tomlfile import write_atomically

if TYPE_CHECKING:
    from pathlib import Path

    from drivecomm.server import ServedPlant, Serving


@click.command(cls=CliCommand)
@click.argument("plant", type=FILE, required=False, help="Plant file. Default: $DRIVECOMM_PLANT or plant.toml here.")
@click.option("--log", type=FILE, help="Log to this file, which rotates.")
@click.option("--level", metavar="LEVEL", default="info", help="What is logged: debug, info, warning or error.")
@click.option("--registers", is_flag=True, help="Print the registers of the Modbus TCP door as Markdown, and exit.")
@click.option("--csv", type=FILE, help="With --registers: write them as CSV, a row each.")
@click.option(
    "--check", is_flag=True, help="Check the plant file and the load of its lines without opening a port, and exit."
)
@force_option
@options.json
def serve(
    *,
    plant: Path | None,
    log: Path | None,
    level: str,
    registers: bool,
    csv: Path | None,
    check: bool,
    force: bool,
    json: bool,
) -> int:
    """Own the lines of a plant, and serve its drives to commands, programs and people.

    The server ends with Ctrl-C or SIGTERM, and reads the plant file again at SIGHUP. When it ends, it treats the motors
    that it keeps by their link-loss policy. Nothing listens on a network unless the plant file names a door that does.
    A file that polls values that a model does not have is refused. With --check, the exit code is 1 if a line cannot
    keep up with its polls.
    """
    path = plant or plant_file(None, port_given=False) or PLANT_FILE
    if csv is not None and not registers:
        raise UsageError("--csv is a format of the registers; give --registers, too")
    must_be_free(csv, "--csv", force=force)
    if registers:
        _tell_registers(path, csv, as_json=json)
        return 0
    must_have("a server", "server", "fastapi", "uvicorn")
    from drivecomm.server import LOG_LEVELS, Serving, keep_searches_short, logging_to

    if level not in LOG_LEVELS:
        raise UsageError(f"unknown level {level!r}; write {', '.join(LOG_LEVELS)}")
    serving = Serving(path)
    if check:
        return _check(path, serving, as_json=json)

    def ready(served: ServedPlant) -> None:
        known, doors = served.plant, serving.doors
        if json:
            emit(
                plant=str(path),
                socket=str(serving.socket),
                doors=doors,
                lines=len(known.lines),
                drives=len(known.drives),
            )
            return
        told = f"{counted(len(known.lines), 'line')}, {counted(len(known.drives), 'drive')}"
        say(f"{path}: {told}; {', '.join(doors) or 'no door to the network'}; stop with Ctrl-C")

    keep_searches_short()
    with logging_to(log, level):
        event_loop.run(partial(serving.run, ready))
    if not json:
        say("ended")
    return 0


def _check(path: Path, serving: Serving, *, as_json: bool) -> int:
    """Check the users of a plant file, and print the load of its lines; opens no line."""
    from drivecomm.server import line_loads, read_users

    if serving.settings.users is not None:
        # A server does not start with an invalid users file.
        read_users(serving.settings.users)
    well = True
    for load in line_loads(serving.plant, serving.settings.status_period_s):
        well = well and load.fits
        told = {"line": load.line, "fits": load.fits, "utilisation": load.utilisation, "text": load.text}
        tell(f"line {load.line}: {load.text}", as_json=as_json, **told)
    if not as_json:
        size = f"{counted(len(serving.plant.lines), 'line')}, {counted(len(serving.plant.drives), 'drive')}"
        say(f"{path}: {size}; {', '.join(serving.doors) or 'no door to the network'}; {'fit' if well else 'not fit'}")
    return 0 if well else 1


def _tell_registers(path: Path, target: Path | None, *, as_json: bool) -> None:
    """Print the registers of a plant's Modbus TCP doors, or write them to a file; opens no line."""
    # Imported late, because only --registers needs it.
    from drivecomm.plant import read_plant
    from drivecomm.server import read_settings
    from drivecomm.server.modbus_tcp import (
        ModbusTcpDoor,
        registers_as_csv,
        registers_as_markdown,
        registers_content,
    )

    known = read_plant(path)
    doors = [ModbusTcpDoor(table) for kind, table in read_settings(path).doors if kind == "modbus-tcp"]
    if not doors:
        raise UsageError(f'{path} has no Modbus TCP door; write a [[door]] with kind = "modbus-tcp" and its units')
    for door in doors:
        door.check_plant(known)
    if target is not None:
        write_atomically(target, registers_as_csv(doors, known))
        tell(f"{target}: {counted(len(doors), 'door')}", as_json=as_json, output=str(target))
    elif as_json:
        for row in registers_content(doors, known):
            emit(**row)
    else:
        for line in registers_as_markdown(doors, known).split("\n"):
            say(line)
