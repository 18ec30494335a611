"""The serve command: one process that owns the lines of a plant, and lets everybody else reach its drives."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from drivecomm.cli.drive_names import PLANT_FILE, plant_file
from drivecomm.cli.options import Json
from drivecomm.cli.output import counted, emit, say
from drivecomm.errors import UsageError

if TYPE_CHECKING:
    from drivecomm.server import ServedPlant


def serve(
    plant: Annotated[
        Path | None, typer.Argument(metavar="[PLANT]", help="Plant file. Default: $DRIVECOMM_PLANT or plant.toml here.")
    ] = None,
    log: Annotated[Path | None, typer.Option("--log", metavar="FILE", help="Log to this file, which rotates.")] = None,
    level: Annotated[str, typer.Option("--level", help="What is logged: debug, info, warning or error.")] = "info",
    json: Json = False,
) -> int:
    """Own the lines of a plant, and serve its drives to commands, programs and people.

    It ends with Ctrl-C or SIGTERM, and reads the plant file again at SIGHUP. Motors that it keeps running are treated
    by their link-loss policy when it ends. Nothing listens on a network unless the plant file names a door that does.
    """
    path = plant or plant_file(None, port_given=False) or PLANT_FILE
    try:
        from drivecomm.server import LOG_LEVELS, Serving, logging_to  # noqa: PLC0415 - its libraries are an extra
    except ModuleNotFoundError as error:
        raise UsageError(f"a server needs {error.name}, which is not installed; install drivecomm[server]") from None
    if level not in LOG_LEVELS:
        raise UsageError(f"unknown level {level!r}; write {', '.join(LOG_LEVELS)}")
    serving = Serving(path)

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

    with logging_to(log, level):
        asyncio.run(serving.run(ready))
    if not json:
        say("ended")
    return 0
