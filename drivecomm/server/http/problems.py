"""Failures as problem details (RFC 9457), with the error that Python callers get in `error`."""

from __future__ import annotations

from http import HTTPStatus
from math import ceil
from typing import TYPE_CHECKING, Any

from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.responses import Response
from starlette.routing import Match

from drivecomm.client import error_content, json_text, plain
from drivecomm.errors import (
    CommandCancelledError,
    DriveCommError,
    LeaseError,
    NotAllowedError,
    TooOftenError,
    UsageError,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from starlette.requests import Request

_SHOWN = 100
"""Maximum characters of an invalid value in its error message."""
_METHODS = ("DELETE", "GET", "HEAD", "OPTIONS", "PATCH", "POST", "PUT")


def problem(status: int, error: DriveCommError, headers: Mapping[str, str] | None = None, **more: Any) -> Response:
    """Return the response for an error. more: further members, such as the outcome of a command."""
    content = error_content(error)
    told = {"title": HTTPStatus(status).phrase, "status": status, "detail": content["text"], **more, "error": content}
    return Response(json_text(told), status, headers, "application/problem+json")


def status_of(error: DriveCommError) -> int:
    """Return the HTTP status for a request that was refused with this error."""
    if isinstance(error, TooOftenError):
        return 429
    if isinstance(error, NotAllowedError):
        return 403
    if isinstance(error, LeaseError | CommandCancelledError):
        return 409
    return 422 if isinstance(error, UsageError) else 503


async def failed(_: Request, error: Any) -> Response:
    """Return the response for an error raised by the plant."""
    headers = {"Retry-After": str(ceil(error.wait_s))} if isinstance(error, TooOftenError) else None
    return problem(status_of(error), error, headers)


async def broken(_: Request, __: Exception) -> Response:
    """Return the response for an internal error: its details go to the log and not to the client."""
    return problem(500, DriveCommError("internal error of the server; see its log"))


async def refused(request: Request, error: Any) -> Response:
    """Return the response for a path or method without a route, and for OPTIONS with all methods of the path."""
    headers, detail = dict(error.headers or {}), error.detail
    if error.status_code == HTTPStatus.METHOD_NOT_ALLOWED:
        headers["Allow"] = ", ".join(each for each in _METHODS if each == "OPTIONS" or _is_served(request, each))
        if request.method == "OPTIONS":
            return Response(status_code=204, headers=headers)
        detail = f"{request.method} is not supported at {request.url.path}"
    elif detail == HTTPStatus.NOT_FOUND.phrase:
        detail = f"{request.url.path} does not exist"
    return http_error_response(HTTPException(error.status_code, detail, headers))


def http_error_response(error: HTTPException) -> Response:
    """Return the response for an HTTPException."""
    kind = NotAllowedError if error.status_code in (401, 403, 429) else UsageError
    return problem(error.status_code, kind(error.detail), error.headers)


async def not_understood(_: Request, error: Any) -> Response:
    """Return the response for an invalid request: names the first invalid field."""
    assert isinstance(error, RequestValidationError)  # noqa: S101 - what it is registered for
    first = error.errors()[0]
    name = ".".join(str(each) for each in first["loc"][1:])
    if first["type"] == "missing":
        return problem(422, UsageError(f"the field {name!r} is missing"))
    given = first["input"]
    shown = str(given) if isinstance(given, float) else json_text(plain(given))
    why = first["msg"].replace("Input", "it").replace("String", "it").replace("dictionary", "object")
    return problem(422, UsageError(f"invalid {name} = {shown:.{_SHOWN}}: {why}"))


def _is_served(request: Request, method: str) -> bool:
    scope = {**request.scope, "method": method}
    return any(route.matches(scope)[0] is Match.FULL for route in request.app.routes)
