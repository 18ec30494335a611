"""Lines of a plant that a server owns."""

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
    """Return the line behind a port through the server that has it; None if no server has it.

    opening: further keywords of `open_bus`.
    """
    found = server_of_port(port)
    if found is None:
        return None
    # HTTP is slow to load, and only needed with a server.
    from drivecomm.client import ServedBus

    server, line = found
    return ServedBus(server, line, drives_of(server, line), **opening)


def async_bus_of_server(port: str, **opening: Any) -> AsyncServedBus | None:
    """Return the line behind a port through the server that has it, for asyncio callers; None if no server has it."""
    found = server_of_port(port)
    if found is None:
        return None
    from drivecomm.client import AsyncServedBus

    server, line = found
    return AsyncServedBus(server, line, drives_of(server, line), **opening)


def drives_of(server: Registration, line: str) -> tuple[DriveConfig, ...]:
    """Return the drives that a server has on a line, from its plant file.

    Returns no drives if the file has become unreadable since; the drives are then reached by their addresses.
    """
    try:
        plant = read_plant(Path(server.plant))
        where = plant.line(line)
    except (FileFormatError, UsageError):
        return ()
    return tuple(where.reached(drive) for drive in plant.on_line(line))
