"""The fleet as a web page: plants at a glance, and the drives of each. It only shows; no request changes anything."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.responses import Response
from starlette.routing import Route

from drivecomm.client import json_text
from drivecomm.server import Bounds, allotted, needed, system_limits
from drivecomm.server.fleet.content import fleet_content, plant_content
from drivecomm.server.http import check_place, files_of, guarded, own_names, serve

if TYPE_CHECKING:
    import socket
    from collections.abc import Callable

    from starlette.requests import Request
    from starlette.types import ASGIApp

    from drivecomm.server.fleet.following import Following

_BOUNDS = Bounds(1000, 250)


async def fleet_page(following: Following, listening: socket.socket, opened: Callable[[], None]) -> None:
    """Serve the page until cancelled. opened: called when it can be looked at."""
    wishes = [_BOUNDS]
    _, (bounds,) = allotted(system_limits(needed(wishes, lines=0, doors=1)), wishes, lines=0, doors=1)
    with listening:
        await serve(_application(following), listening, opened, _nothing, bounds=bounds, clients=set())


def _application(following: Following) -> ASGIApp:
    # Styles and what draws elements are those of a server's page.
    shared, own = files_of("drivecomm.server.http"), files_of("drivecomm.server.fleet")

    async def plants(_: Request) -> Response:
        return _as_json(fleet_content(following))

    async def plant(request: Request) -> Response:
        name = unquote(request.path_params["name"])
        if name not in following.fleet.plants:
            raise HTTPException(404, f"no plant {name!r} has told anything")
        return _as_json(plant_content(following, name))

    app = Starlette(
        routes=[
            Route("/plants", plants),
            Route("/plants/{name:path}", plant),
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


def _as_json(content: dict[str, Any]) -> Response:
    return Response(json_text(content), media_type="application/json")


async def _nothing() -> None:
    """Nothing goes on for ever here."""
