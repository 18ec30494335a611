"""What the API tells: the plant, its drives and values, what happened, and what comes."""

from __future__ import annotations

import asyncio
import time
from collections import defaultdict
from typing import TYPE_CHECKING

from starlette.exceptions import HTTPException
from starlette.responses import PlainTextResponse, Response

from drivecomm.client import json_text, plain
from drivecomm.errors import UsageError
from drivecomm.server.http.content import aged, drive_text, joined, lease_content, plant_content, value_head

if TYPE_CHECKING:
    from starlette.requests import Request
    from starlette.types import Receive, Scope, Send

    from drivecomm.server import CurrentValue, DriveState, History
    from drivecomm.server.http.asked import Asked, DoorState

_DAY_S = 86400.0


def json_answer(content: object) -> Response:
    """Return an answer with this content."""
    return Response(json_text(plain(content)), media_type="application/json")


async def plant(asked: Asked) -> Response:
    """Tell of the plant as a whole."""
    return json_answer(plant_content(asked.plant, asked.caller))


async def drives(asked: Asked) -> Response:
    """Tell of all drives."""
    values = defaultdict[str, "list[CurrentValue]"](list)
    for value in asked.plant.values():
        values[value.drive].append(value)
    found = asked.plant.drives()
    texts = (drive_text(asked.plant, drive, values[drive.name], asked.caller) for drive in found)
    return Response(await joined(texts), media_type="application/json")


async def drive(asked: Asked) -> Response:
    """Tell of one drive."""
    found = drive_of(asked)
    values = [value for value in asked.plant.values() if value.drive == found.name]
    return Response(drive_text(asked.plant, found, values, asked.caller), media_type="application/json")


async def values(asked: Asked) -> Response:
    """Tell all current values."""
    now = time.time()
    texts = (aged(value_head(value), value, now) for value in asked.plant.values())
    return Response(await joined(texts), media_type="application/json")


async def events(asked: Asked) -> Response:
    """Tell the latest events."""
    found = list(asked.plant.events())[-asked.given.get("limit", 1000) :]
    return json_answer(found)


async def history(asked: Asked) -> Response:
    """Tell a quantity as it was."""
    journal, given = _journal(asked), asked.given
    from_s, to_s = _span(asked)
    points = await journal.points(given["drive"], given["name"], from_s, to_s, given.get("points", 500))
    return json_answer({"points": points})


async def past_events(asked: Asked) -> Response:
    """Tell events as the journal has them."""
    given = asked.given
    from_s, to_s = _span(asked)
    found = await _journal(asked).events(
        drive=given.get("drive", ""),
        kind=given.get("kind", ""),
        from_s=from_s,
        to_s=to_s,
        limit=given.get("limit", 1000),
    )
    return json_answer(found)


async def leases(asked: Asked) -> Response:
    """Tell who commands what."""
    return json_answer([lease_content(lease, asked.caller) for lease in asked.plant.leases()])


async def alarms(asked: Asked) -> Response:
    """Tell the alarms."""
    return json_answer(asked.plant.alarms())


class _Stream(Response):
    """Goes on until the client or the door ends it."""

    def __init__(self, asked: Asked) -> None:
        super().__init__()
        self._asked = asked

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        asked = self._asked
        given = asked.given
        drives = frozenset(asked.plant.drive(name).name for name in given["drives"]) if "drives" in given else None
        hello = json_text(plain(plant_content(asked.plant, asked.caller)))
        connection = (scope["state"]["transport"], receive, send)
        await asked.door.streams.serve(connection, hello, drives, given.get("every", 0.0), _last_event(asked.request))


async def stream(asked: Asked) -> Response:
    """Tell values and events as they come."""
    for name in asked.given.get("drives", ()):
        _known(asked, name)
    if asked.request.scope["http_version"] != "1.1":
        raise HTTPException(505, "a stream needs HTTP/1.1")
    return _Stream(asked)


async def metrics(asked: Asked) -> Response:
    """Tell Prometheus all that there is; made in a thread, one at a time, because it takes long for a large plant."""
    accept = asked.request.headers.get("accept", "")
    async with asked.door.rendering:
        text, media_type = await asyncio.to_thread(asked.door.metrics.rendered, accept)
    return Response(text, media_type=None, headers={"Content-Type": media_type})


def health(_: DoorState) -> Response:
    """Say that the process is there."""
    return PlainTextResponse("ok\n")


def readiness(door: DoorState) -> Response:
    """Say whether all lines are open."""
    closed = [line.name for line in door.plant.lines() if not line.up]
    if closed:
        return PlainTextResponse(f"{len(closed)} of {len(door.plant.lines())} lines are not open\n", 503)
    return PlainTextResponse("ready\n")


def drive_of(asked: Asked) -> DriveState:
    """Return the drive that the address names. Raises HTTPException."""
    return _known(asked, asked.path["name"])


def _known(asked: Asked, name: str) -> DriveState:
    try:
        return asked.plant.drive(name)
    except UsageError as error:
        raise HTTPException(404, str(error)) from None


def _journal(asked: Asked) -> History:
    if asked.plant.history is None:
        raise HTTPException(404, "this server keeps no history; leave history = false out of its plant file")
    return asked.plant.history


def _span(asked: Asked) -> tuple[float, float]:
    to_s = asked.given.get("to", time.time())
    return asked.given.get("from", to_s - _DAY_S), to_s


def _last_event(request: Request) -> int | None:
    text = request.headers.get("last-event-id", "")
    return int(text) if text.isascii() and text.isdigit() and len(text) < 19 else None
