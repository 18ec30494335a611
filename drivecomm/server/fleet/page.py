"""The fleet as a web page: an overview of plants, and the drives of each. Read-only: no request changes anything."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar
from urllib.parse import unquote

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.responses import Response
from starlette.routing import Route

from drivecomm.client import json_text
from drivecomm.errors import LinkError, UsageError
from drivecomm.server import Bounds, needed_descriptors, share_connections, system_limits
from drivecomm.server.fleet.content import fleet_content, plant_content
from drivecomm.server.http import check_place, files_of, guarded, own_names, serve

if TYPE_CHECKING:
    import socket
    from collections.abc import Awaitable, Callable

    from starlette.requests import Request
    from starlette.types import ASGIApp

    from drivecomm.server.fleet.following import FleetSubscription
    from drivecomm.server.fleet.past_pages import RecordPages

_BOUNDS = Bounds(1000, 250)
_TREND_S = 86_400.0
T = TypeVar("T")


async def fleet_page(
    following: FleetSubscription, listening: socket.socket, opened: Callable[[], None], past: RecordPages | None = None
) -> None:
    """Serve the page until cancelled. opened: called when the page can be opened. past: None without a record."""
    wishes = [_BOUNDS]
    _, (bounds,) = share_connections(
        system_limits(needed_descriptors(wishes, lines=0, doors=1)), wishes, lines=0, doors=1
    )
    with listening:
        await serve(_application(following, past), listening, opened, _nothing, bounds=bounds, clients=set())


def _application(following: FleetSubscription, past: RecordPages | None) -> ASGIApp:
    # Style sheets and shared scripts are those of a server's page.
    shared, own = files_of("drivecomm.server.http"), files_of("drivecomm.server.fleet")

    async def plants(_: Request) -> Response:
        return _as_json({**fleet_content(following), "has_record": past is not None})

    async def plant(request: Request) -> Response:
        name = unquote(request.path_params["name"])
        if name not in following.fleet.plants:
            raise HTTPException(404, f"no plant {name!r} has published anything")
        return _as_json({**plant_content(following, name), "has_record": past is not None})

    async def alarms(_: Request) -> Response:
        return _as_json({"problem": following.problem, "alarms": await _found(_recorded(past).alarms())})

    async def trend(request: Request) -> Response:
        name, drive, quantity = (unquote(request.path_params[each]) for each in ("name", "drive", "quantity"))
        picture = await _found(_recorded(past).trend(name, drive, quantity, _TREND_S))
        return Response(picture, media_type="image/svg+xml")

    app = Starlette(
        routes=[
            Route("/plants", plants),
            Route("/plants/{name:path}/{drive}/{quantity}/trend.svg", trend),
            Route("/plants/{name:path}", plant),
            Route("/alarms", alarms),
            Route("/fleet/{path:path}", own),
            Route("/page/{path:path}", shared),
            Route("/", own),
        ]
    )
    return guarded(
        app,
        partial(check_place, names=own_names()),
        lambda error: Response(error.detail, error.status_code),
    )


def _recorded(past: RecordPages | None) -> RecordPages:
    if past is None:
        raise HTTPException(404, "there is no record; give one with --from")
    return past


async def _found(reading: Awaitable[T]) -> T:
    try:
        return await reading
    except UsageError as error:
        raise HTTPException(404, str(error)) from error
    except LinkError as error:
        raise HTTPException(503, str(error)) from error


def _as_json(content: dict[str, Any]) -> Response:
    return Response(json_text(content), media_type="application/json")


async def _nothing() -> None:
    """Do nothing: this page needs no background work."""
