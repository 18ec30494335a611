"""The lines of a plant that a server owns."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from drivecomm.client import server_of_port
from drivecomm.errors import FileFormatError, UsageError
from drivecomm.plant.files import read_plant

if TYPE_CHECKING:
    from drivecomm.client import AsyncServedBus, Registration, ServedBus
    from drivecomm.protocol import DriveConfig


def bus_of_server(port: str, **opening: Any) -> ServedBus | None:
    """Return the line behind a port through the server that has it; None where none has.

    opening: further keywords of `open_bus`.
    """
    found = server_of_port(port)
    if found is None:
        return None
    # HTTP takes long to load, and is for those who go through a server.
    from drivecomm.client import ServedBus

    server, line = found
    return ServedBus(server, line, drives_of(server, line), **opening)


def async_bus_of_server(port: str, **opening: Any) -> AsyncServedBus | None:
    """Return the same for callers that await."""
    found = server_of_port(port)
    if found is None:
        return None
    from drivecomm.client import AsyncServedBus

    server, line = found
    return AsyncServedBus(server, line, drives_of(server, line), **opening)


def drives_of(server: Registration, line: str) -> tuple[DriveConfig, ...]:
    """Return the drives that a server has on a line, as its plant file says.

    None are known where the file has been changed so that it cannot be read: they are then asked by their addresses.
    """
    try:
        plant = read_plant(Path(server.plant))
        where = plant.line(line)
    except (FileFormatError, UsageError):
        return ()
    return tuple(where.reached(drive) for drive in plant.on_line(line))
