"""The application of a door: the table of routes, carried out by starlette, with its checks in front of it."""

from __future__ import annotations

import logging
from dataclasses import replace
from functools import partial
from http import HTTPStatus
from math import ceil
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.responses import Response
from starlette.routing import Route as Served

from drivecomm.client import error_content, json_text
from drivecomm.errors import DriveCommError, NotAllowedError, TooOftenError, UsageError
from drivecomm.server import ANONYMOUS, Caller, Role
from drivecomm.server.http.asked import Asked
from drivecomm.server.http.commanding import status_of
from drivecomm.server.http.fields import of_body, of_query
from drivecomm.server.http.guard import guarded, whole_body
from drivecomm.server.http.openapi import description
from drivecomm.server.http.page_files import files_of
from drivecomm.server.http.reading import health, json_answer, readiness
from drivecomm.server.http.routes import ROUTES

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from starlette.requests import Request
    from starlette.types import ASGIApp, Scope

    from drivecomm.server.http.asked import DoorState
    from drivecomm.server.http.callers import Callers
    from drivecomm.server.http.routes import Route

_LOG = logging.getLogger("drivecomm.server.http")


def application(door: DoorState, callers: Callers, check_place: Callable[[Scope], None], *, local: bool) -> ASGIApp:
    """Return what serves the requests of a door.

    check_place: raises HTTPException for requests from where none may come. local: it is the local door.
    """
    file = files_of("drivecomm.server.http")

    def served(path: str, routes: Mapping[str, Route]) -> Served:
        async def endpoint(request: Request) -> Response:
            route = routes["GET" if request.method == "HEAD" else request.method]
            request.scope["state"]["standing"].streams = route.form == "events"
            return await route.carry_out(await _asked(route, request, door, callers, local=local))

        found = Served(path, endpoint, methods=list(routes))
        if found.methods and any(route.form in ("events", "lines") for route in routes.values()):
            found.methods.discard("HEAD")
        return found

    async def described(_: Request) -> Response:
        return json_answer(description(local=local))

    async def plainly(answer: Callable[[DoorState], Response], _: Request) -> Response:
        return answer(door)

    app = Starlette(
        routes=[
            *(served(path, routes) for path, routes in _by_path().items()),
            Served("/openapi.json", described),
            Served("/healthz", partial(plainly, health)),
            Served("/readyz", partial(plainly, readiness)),
            Served("/page/{path:path}", file),
            Served("/", file),
        ],
        exception_handlers={HTTPException: _told, DriveCommError: _failed, Exception: _broken},
    )
    return guarded(app, check_place, lambda error: _error(error.status_code, error.detail))


def _by_path() -> Mapping[str, Mapping[str, Route]]:
    """Return the routes of each path by their methods, so that an answer can name all of them."""
    found: dict[str, dict[str, Route]] = {}
    for route in ROUTES:
        found.setdefault(route.path, {})[route.method] = route
    return found


async def _asked(route: Route, request: Request, door: DoorState, callers: Callers, *, local: bool) -> Asked:
    caller = _caller(route, request, callers, local=local)
    query = of_query(request.query_params.multi_items(), route.query, local=local)
    body = b"" if route.method == "GET" else await whole_body(request)
    path = {name: unquote(text) for name, text in request.path_params.items()}
    fields = route.body
    if path.get("verb") == "stop":
        # It acts each time that it comes, so that nothing has to tell it apart.
        fields = {name: replace(field, network=False) for name, field in fields.items()}
    given = query if route.method == "GET" else of_body(body, fields, local=local)
    return Asked(door=door, request=request, caller=caller, path=path, given=given)


def _caller(route: Route, request: Request, callers: Callers, *, local: bool) -> Caller:
    caller = callers.of(request.scope)
    if caller is not None and caller.name != ANONYMOUS:
        request.scope["state"]["standing"].known = True
    if route.role is not Role.NOBODY:
        if caller is None or (route.named and caller.name == ANONYMOUS):
            text = "give the token of a user who may: Authorization: Bearer TOKEN"
            raise HTTPException(401, text, {"WWW-Authenticate": "Bearer"})
        if caller.role < route.role:
            raise HTTPException(
                403, f"{caller} has the role {caller.role.name.lower()}; this needs {route.role.name.lower()}"
            )
    if route.local and not local:
        raise HTTPException(403, "this is for callers of the local door only")
    return caller or Caller(name=ANONYMOUS, role=Role.NOBODY, door="")


def _error(status: int, text: str, headers: Mapping[str, str] | None = None) -> Response:
    kind = NotAllowedError if status in (401, 403, 429) else UsageError
    return _as_json(status, error_content(kind(text)), headers)


def _as_json(status: int, content: dict[str, Any], headers: Mapping[str, str] | None = None) -> Response:
    return Response(json_text({"error": content}), status, dict(headers or {}), "application/json")


async def _told(request: Request, error: Exception) -> Response:
    if not isinstance(error, HTTPException):
        return await _broken(request, error)
    headers = dict(error.headers or {})
    if error.status_code == HTTPStatus.METHOD_NOT_ALLOWED:
        headers["Allow"] = ", ".join(sorted({"OPTIONS", *headers["Allow"].split(", ")}))
        if request.method == "OPTIONS":
            return Response(status_code=HTTPStatus.NO_CONTENT, headers=headers)
    text = {404: f"there is nothing at {request.url.path}", 405: f"{request.method} is not for {request.url.path}"}
    detail = error.detail
    if detail in ("Not Found", "Method Not Allowed"):
        detail = text[error.status_code]
    return _error(error.status_code, detail, headers)


async def _failed(request: Request, error: Exception) -> Response:
    if not isinstance(error, DriveCommError):
        return await _broken(request, error)
    headers = {"Retry-After": str(ceil(error.wait_s))} if isinstance(error, TooOftenError) else None
    return _as_json(status_of(error), error_content(error), headers)


async def _broken(_: Request, __: Exception) -> Response:
    """Answer for a mistake of ours: its place is for the log, and not for whoever asked."""
    return _as_json(500, error_content(DriveCommError("the server has made a mistake; its log says which")))
