"""Stops that one program requests from another one, through its local door."""

from __future__ import annotations

import os
from contextlib import closing
from functools import partial
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from drivecomm.bus import make_despite_errors
from drivecomm.errors import ServerLostError, UsageError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.bus import AwaitedLine, BlockingLine
    from drivecomm.client.connection import LocalServer
    from drivecomm.client.door_for_stops import StopOrder
    from drivecomm.client.registration import Registration
    from drivecomm.protocol import Stop

_ALIVE_S = 1.0
# Time for a stop with all attempts that silent drives may need.
_LONGEST_S = 20.0


def place_on_line(line: str, whom: str) -> str:
    """Return the path of a drive on a line, PROTOCOL:ADDRESS, or of all drives of a protocol, PROTOCOL:*."""
    return f"/api/v1/lines/{quote(line, safe='')}/drives/{quote(whom, safe=':*')}"


def place_of_name(name: str) -> str:
    """Return the path of a drive by its name in the server's plant."""
    return f"/api/v1/drives/{quote(name, safe='')}"


def request_stop(program: Registration, place: str, how: Stop, options: Mapping[str, Any] | None = None) -> None:
    """Request a stop of a drive, or of all drives of a protocol, from a server or another program that has a port.

    options: options of the drive; left out if the program does not accept them. Raises the program's error, and
    ServerLostError if it does not respond.
    """
    from drivecomm.client.wire import error_of

    asked = {"id": os.urandom(8).hex(), "arguments": {"how": how.value}, **({"options": options} if options else {})}
    server = _server(program)
    try:
        answer = server.order(f"{place}/stop", asked, limit_s=_LONGEST_S)
        if answer.get("error"):
            raise error_of(answer["error"])
    except UsageError:
        if not options:
            raise
        request_stop(program, place, how)


def _server(program: Registration) -> LocalServer:
    # Imported late, because programs that only have a port do not need it.
    from drivecomm.client.connection import LocalServer

    return LocalServer(program, alive_s=_ALIVE_S)


def check_alive(program: Registration) -> None:
    """Raise ServerLostError unless a program responds, as a check before larger requests."""
    if not _server(program).is_alive():
        raise ServerLostError(f"{program} does not answer")


def drives_known_to(program: Registration) -> list[dict[str, Any]]:
    """Return the drives of a server: name, line, and drive as PROTOCOL:ADDRESS."""
    with closing(_server(program)) as server:
        found: list[dict[str, Any]] = server.ask("/api/v1/drives", limit_s=_LONGEST_S)
        return found


def stop_on(bus: BlockingLine, order: StopOrder) -> None:
    """Carry out a stop that another program has requested. Raises the error of the drive."""
    _meant(bus, order).stop(order.how)


async def stop_on_async(bus: AwaitedLine, order: StopOrder) -> None:
    """Carry out a stop that another program has requested, on an asyncio bus."""
    await _meant(bus, order).stop(order.how)


def _meant(bus: BlockingLine | AwaitedLine, order: StopOrder) -> Any:
    """Return the drive that the order names, or all drives of its protocol, on a bus."""
    from drivecomm.client.wire import drive_options

    options = drive_options(order.options)
    if order.address is None:
        return make_despite_errors(partial(bus.broadcast, order.protocol), options)[0]
    return make_despite_errors(partial(bus.drive, order.protocol, order.address), options)[0]
