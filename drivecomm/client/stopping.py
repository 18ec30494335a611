"""A stop as one program has another one carry it out, by its local door."""

from __future__ import annotations

import os
from contextlib import closing
from functools import partial
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from drivecomm.bus import as_far_as_possible
from drivecomm.errors import ServerLostError, UsageError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.bus import AwaitedLine, BlockingLine
    from drivecomm.client.connection import LocalServer
    from drivecomm.client.door_for_stops import StopOrder
    from drivecomm.client.registration import Registration
    from drivecomm.protocol import Stop

_ALIVE_S = 1.0
# A stop with all the attempts that silent drives may have.
_LONGEST_S = 20.0


def place_on_line(line: str, whom: str) -> str:
    """Return the path of a drive, PROTOCOL:ADDRESS, or of all of a protocol, PROTOCOL:*, on a line."""
    return f"/api/v1/lines/{quote(line, safe='')}/drives/{quote(whom, safe=':*')}"


def place_of_name(name: str) -> str:
    """Return the path of a drive by the name that its server's plant gives it."""
    return f"/api/v1/drives/{quote(name, safe='')}"


def have_stopped(program: Registration, place: str, how: Stop, options: Mapping[str, Any] | None = None) -> None:
    """Have a server, or another program that has a port, stop a drive, or all of a protocol.

    options: what is said of the drive; left out where the program cannot take it. Raises what it answers, and
    ServerLostError if it does not.
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
        have_stopped(program, place, how)


def _server(program: Registration) -> LocalServer:
    # Loaded by those who have another program, not by those who only have a port.
    from drivecomm.client.connection import LocalServer

    return LocalServer(program, alive_s=_ALIVE_S)


def check_alive(program: Registration) -> None:
    """Raise ServerLostError unless a program answers at all, before much is asked of it."""
    if not _server(program).is_alive():
        raise ServerLostError(f"{program} does not answer")


def drives_known_to(program: Registration) -> list[dict[str, Any]]:
    """Return the drives of a server as it tells them: their name, their line, and drive as PROTOCOL:ADDRESS."""
    with closing(_server(program)) as server:
        found: list[dict[str, Any]] = server.ask("/api/v1/drives", limit_s=_LONGEST_S)
        return found


def stop_on(bus: BlockingLine, order: StopOrder) -> None:
    """Carry a stop out that has come from another program. Raises the error of the drive."""
    _meant(bus, order).stop(order.how)


async def stop_on_async(bus: AwaitedLine, order: StopOrder) -> None:
    """Do the same over an awaited bus."""
    await _meant(bus, order).stop(order.how)


def _meant(bus: BlockingLine | AwaitedLine, order: StopOrder) -> Any:
    """Return the drive, or all of a protocol, of a bus."""
    from drivecomm.client.wire import drive_options

    options = drive_options(order.options)
    if order.address is None:
        return as_far_as_possible(partial(bus.broadcast, order.protocol), options)[0]
    return as_far_as_possible(partial(bus.drive, order.protocol, order.address), options)[0]
