"""Virtual drives for other programs: what the simulate command serves, and what it tells of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.cli.drive_names import parse_drive
from drivecomm.cli.output import emit, say
from drivecomm.cli.signals import until_stopped
from drivecomm.errors import DriveCommError, FileFormatError, UsageError
from drivecomm.plant import Plant, PlantDrive, PlantLine, read_plant
from drivecomm.virtual import PlantServer, VirtualPlant

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

_ANY_PORT = "127.0.0.1:0"


def serve(server: PlantServer, *, ready: Callable[[PlantServer], None]) -> None:
    """Serve until Ctrl-C or SIGTERM; ready is told when masters may connect."""
    with until_stopped() as stop, server:
        ready(server)
        server.run(stop)


def server_of_drives(
    drives: list[str], listen: str, *, echo: bool, paced: bool, speed: float, control: str
) -> PlantServer:
    """Return the server of one line with these drives. Raises UsageError."""
    if not drives or not listen:
        raise UsageError("nothing to simulate; name a plant file, or at least one --drive and a place to --listen at")
    names = [parse_drive(text) for text in drives]
    plant = Plant(
        lines=(PlantLine(name="line", listen=listen, echo=echo, paced=paced),),
        drives=tuple(
            PlantDrive(protocol=name.protocol, address=name.address, options=name.options, line="line")
            for name in names
        ),
    )
    return PlantServer(VirtualPlant(plant, speed=speed), control=control)


def server_of_file(path: Path, *, speed: float, control: str) -> PlantServer:
    """Return the server of a plant file; it has a control socket in any case. Raises FileFormatError."""
    plant = read_plant(path)
    try:
        return PlantServer(VirtualPlant(plant, speed=speed), control=control or _ANY_PORT)
    except DriveCommError as error:
        raise FileFormatError(f"{path}: {error}") from error


def tell_drives(server: PlantServer) -> None:
    """Print one line for people."""
    for line, address in server.addresses.items():
        say(f"{', '.join(_drives_on(server, line))} on {address}{_steered(server)}; stop with Ctrl-C")


def tell_plant(server: PlantServer, path: Path) -> None:
    """Print a line for people about the plant, and one about each of its lines."""
    plant = server.plant.plant
    size = f"{_count(len(plant.lines), 'line')}, {_count(len(plant.drives), 'drive')}"
    say(f"{path}: {size}{_steered(server)}; stop with Ctrl-C")
    for line, address in server.addresses.items():
        say(f"{line} on {address}: {', '.join(_drives_on(server, line)) or 'no drive'}")


def tell_drives_as_json(server: PlantServer) -> None:
    """Print one object."""
    for line, address in server.addresses.items():
        emit(listening=address, drives=_drives_on(server, line), **_control_of(server))


def tell_plant_as_json(server: PlantServer, path: Path) -> None:
    """Print one object."""
    lines = [
        {"line": line, "listening": address, "drives": _drives_on(server, line)}
        for line, address in server.addresses.items()
    ]
    emit(plant=str(path), lines=lines, **_control_of(server))


def _drives_on(server: PlantServer, line: str) -> list[str]:
    return [drive.name for drive in server.plant.plant.on_line(line)]


def _steered(server: PlantServer) -> str:
    return f"; control at {server.control}" if server.control else ""


def _control_of(server: PlantServer) -> dict[str, str]:
    return {"control": server.control} if server.control else {}


def _count(number: int, what: str) -> str:
    return f"{number} {what}" + ("" if number == 1 else "s")
