"""Static files of a web page, from the folder `page` of a package."""

from __future__ import annotations

from importlib import resources
from typing import TYPE_CHECKING
from urllib.parse import unquote

from starlette.staticfiles import StaticFiles

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable

    from starlette.requests import Request
    from starlette.responses import Response


def files_of(package: str) -> Callable[[Request], Awaitable[Response]]:
    """Return an endpoint that serves the file at the `path` of a route, or index.html if the route has no path."""
    folder = StaticFiles(directory=str(resources.files(package).joinpath("page")))

    async def file(request: Request) -> Response:
        found = await folder.get_response(unquote(request.path_params.get("path", "index.html")), request.scope)
        # Browsers revalidate each time; the response is nearly always 304 and cheap.
        found.headers["Cache-Control"] = "no-cache"
        return found

    return file
