"""The files of a page: what lies in the folder named page of a package."""

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
    """Return what answers with the file at the `path` of a route, with index.html where it has none."""
    folder = StaticFiles(directory=str(resources.files(package).joinpath("page")))

    async def file(request: Request) -> Response:
        found = await folder.get_response(unquote(request.path_params.get("path", "index.html")), request.scope)
        # Asked for anew each time, which costs little: the answer is mostly that it is still the same.
        found.headers["Cache-Control"] = "no-cache"
        return found

    return file
