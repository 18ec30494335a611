"""The simulate command: virtual drives for other programs, in real time."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import click

from drivecomm.cli import options
from drivecomm.cli.commands import Command
from drivecomm.cli.output import counted, emit, note, say
from drivecomm.cli.signals import until_stopped
from drivecomm.cli.values import FILE, NUMBER
from drivecomm.errors import DriveCommError, FileFormatError, UsageError
from drivecomm.plant import Plant, PlantLine, read_plant, unreadable_polls
from drivecomm.protocol import parse_drive
from drivecomm.virtual import PlantServer, VirtualPlant

if TYPE_CHECKING:
    from pathlib import Path

_ANY_PORT = "127.0.0.1:0"


@click.command(cls=Command)
@click.argument("plant", type=FILE, required=False, help="A plant file: lines, drives, faults.")
@click.option("--drive", "-d", metavar="DRIVE", multiple=True, help="PROTOCOL:ADDRESS[,model=...]; repeatable.")
@click.option(
    "--listen",
    "-l",
    metavar="PLACE",
    show_default=False,
    default="",
    help="pty:PATH, tcp:HOST:PORT or rfc2217:HOST:PORT.",
)
@click.option("--echo", is_flag=True, help="Echo what the master sends, as some adapters do.")
@click.option("--paced", is_flag=True, help="Characters take as long as on a real line.")
@click.option(
    "--speed", type=NUMBER, metavar="N", default=1.0, help="Run motors and faults N times as fast, but not the lines."
)
@click.option(
    "--control",
    show_default=False,
    metavar="PLACE",
    default="",
    help="Control socket for drivecomm plant: HOST:PORT or unix:PATH.",
)
@options.json
def simulate(
    *,
    plant: Path | None,
    drive: tuple[str, ...],
    listen: str,
    echo: bool,
    paced: bool,
    speed: float,
    control: str,
    json: bool,
) -> int:
    """Serve virtual drives to other programs until Ctrl-C or SIGTERM, as on a real line.

    Give a plant file, or one line with --drive and --listen. A plant file always has a control socket, at a free port
    of this machine unless --control says where.
    """
    if plant is None:
        if not drive or not listen:
            raise UsageError("nothing to simulate; name a plant file, or at least one --drive and --listen")
        lines = (PlantLine(name="line", listen=listen, echo=echo, paced=paced),)
        drives = tuple(replace(parse_drive(text), line="line") for text in drive)
        server = PlantServer(VirtualPlant(Plant(lines=lines, drives=drives), speed=speed), control=control)
    elif drive or listen or echo or paced:
        raise UsageError("the plant file has drives, listen, echo and paced; leave these options out")
    else:
        virtual = read_plant(plant)
        for text in unreadable_polls(virtual):
            note(f"{plant}: {text}")
        try:
            server = PlantServer(VirtualPlant(virtual, speed=speed), control=control or _ANY_PORT)
        except DriveCommError as error:
            raise FileFormatError(f"{plant}: {error}") from error
    with until_stopped() as stop, server:
        (_emit if json else _say)(server, plant)
        server.run(stop)
    if not json:
        say("stopped")
    return 0


def _say(server: PlantServer, path: Path | None) -> None:
    steered = f"; control at {server.control}" if server.control else ""
    if path is not None:
        plant = server.plant.plant
        size = f"{counted(len(plant.lines), 'line')}, {counted(len(plant.drives), 'drive')}"
        say(f"{path}: {size}{steered}; stop with Ctrl-C")
    for line, address in server.addresses.items():
        names = ", ".join(_drives_on(server, line))
        if path is None:
            say(f"{names} on {address}{steered}; stop with Ctrl-C")
        else:
            say(f"{line} on {address}: {names or 'no drive'}")


def _emit(server: PlantServer, path: Path | None) -> None:
    control = {"control": server.control} if server.control else {}
    lines = [
        {"line": line, "listening": address, "drives": _drives_on(server, line)}
        for line, address in server.addresses.items()
    ]
    if path is None:
        del lines[0]["line"]
        emit(**lines[0], **control)
    else:
        emit(plant=str(path), lines=lines, **control)


def _drives_on(server: PlantServer, line: str) -> list[str]:
    return [drive.name for drive in server.plant.plant.on_line(line)]
