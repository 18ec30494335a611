"""Routes that read: the plant, its drives and values, events, and the live stream."""

from __future__ import annotations

import asyncio
import time
from collections import defaultdict
from typing import TYPE_CHECKING, Annotated

from fastapi import Query
from starlette.exceptions import HTTPException
from starlette.responses import PlainTextResponse, Response

from drivecomm.client import json_text, plain
from drivecomm.errors import UsageError
from drivecomm.server.http import answers
from drivecomm.server.http.content import (
    aged,
    drift_content,
    drive_text,
    joined,
    lease_content,
    plant_content,
    value_head,
)
from drivecomm.server.http.fields import DriveName, Limit, Names, Number, Text
from drivecomm.server.http.route import V1, ApiRequest, EventStream, json_answer, route

if TYPE_CHECKING:
    from starlette.types import Receive, Scope, Send

    from drivecomm.server import CurrentValue, DriveSnapshot


@route("GET", f"{V1}/plant", answers.Plant)
async def plant(asked: ApiRequest) -> Response:
    """The plant as a whole, and the name and role of the caller."""
    return json_answer(plant_content(asked.plant, asked.caller))


@route("GET", f"{V1}/drives", answers.Drives)
async def drives(
    asked: ApiRequest,
    group: Annotated[Text | None, Query(description="the name of a group; all drives unless given")] = None,
) -> Response:
    """All drives, or those of a group, with their status, faults, leases and current values."""
    found = asked.plant.drives()
    if group is not None:
        names = _in_group(asked, group)
        found = [drive for drive in found if drive.name in names]
    values = defaultdict[str, "list[CurrentValue]"](list)
    for value in asked.plant.values():
        values[value.drive].append(value)
    texts = (drive_text(asked.plant, drive, values[drive.name], asked.caller) for drive in found)
    return Response(await joined(texts), media_type="application/json")


@route("GET", f"{V1}/drives/{{name}}", answers.Drive)
async def drive(asked: ApiRequest, name: DriveName) -> Response:
    """One drive."""
    found = find_drive(asked, name)
    values = [value for value in asked.plant.values() if value.drive == found.name]
    return Response(drive_text(asked.plant, found, values, asked.caller), media_type="application/json")


@route("GET", f"{V1}/drives/{{name}}/drift", answers.Drift)
async def drift(asked: ApiRequest, name: DriveName) -> Response:
    """Differences between a drive and its baseline, as found by the last backup of this server."""
    return json_answer(drift_content(find_drive(asked, name)))


@route("GET", f"{V1}/values", answers.Values)
async def values(asked: ApiRequest) -> Response:
    """All current values, with unit, quality, source time and age."""
    now = time.time()
    texts = (aged(value_head(value), value, now) for value in asked.plant.values())
    return Response(await joined(texts), media_type="application/json")


@route("GET", f"{V1}/events", answers.Events)
async def events(asked: ApiRequest, limit: Limit = 1000) -> Response:
    """The latest events of this run of the server, oldest first."""
    return json_answer(list(asked.plant.events())[-limit:])


@route("GET", f"{V1}/stream", form=EventStream)
async def stream(
    asked: ApiRequest,
    drives: Annotated[
        Names | None, Query(description="names, with commas between them; all drives unless given")
    ] = None,
    every: Annotated[
        Number | None, Query(ge=0.05, le=3600, description="minimum interval between values, in seconds")
    ] = None,
) -> Response:
    """Live values and events as Server-Sent Events."""
    chosen = None if drives is None else frozenset(find_drive(asked, name).name for name in drives)
    if asked.scope["http_version"] != "1.1":
        raise HTTPException(505, "a stream needs HTTP/1.1")

    async def serve(scope: Scope, receive: Receive, send: Send) -> None:
        hello = json_text(plain(plant_content(asked.plant, asked.caller)))
        text = asked.headers.get("last-event-id", "")
        last_event = int(text) if text.isascii() and text.isdigit() and len(text) < 19 else None
        connection = (scope["state"]["transport"], receive, send)
        await asked.door.streams.serve(connection, hello, chosen, every or 0.0, last_event)

    return EventStream(serve)


@route("GET", f"{V1}/leases", answers.Leases)
async def leases(asked: ApiRequest) -> Response:
    """All leases, with drive and holder."""
    return json_answer([lease_content(lease, asked.caller) for lease in asked.plant.leases()])


@route("GET", f"{V1}/alarms", answers.Alarms)
async def alarms(asked: ApiRequest) -> Response:
    """Alarms that are active or not acknowledged."""
    return json_answer(asked.plant.alarms())


@route("GET", "/metrics", form=PlainTextResponse)
async def metrics(asked: ApiRequest) -> Response:
    """All values, drives and lines for Prometheus."""
    accept = asked.headers.get("accept", "")
    # In a thread and one at a time, because rendering a large plant is slow.
    async with asked.door.rendering:
        text, media_type = await asyncio.to_thread(asked.door.metrics.rendered, accept)
    return Response(text, media_type=None, headers={"Content-Type": media_type})


def _in_group(asked: ApiRequest, group: str) -> set[str]:
    """Return the names of the drives of a group. Raises HTTPException if the group is unknown."""
    try:
        return {drive.name for drive in asked.plant.plant.group(group)}
    except UsageError as error:
        raise HTTPException(404, str(error)) from None


def find_drive(asked: ApiRequest, name: str) -> DriveSnapshot:
    """Return the drive of this name. Raises HTTPException if it is unknown."""
    try:
        return asked.plant.drive(name)
    except UsageError as error:
        raise HTTPException(404, str(error)) from None
