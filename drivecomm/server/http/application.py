"""The application of a door: FastAPI serves its routes behind the door's own checks."""

from __future__ import annotations

import asyncio
from functools import cache
from typing import TYPE_CHECKING, Any

from fastapi import FastAPI
from fastapi.exceptions import RequestValidationError
from fastapi.openapi.utils import get_openapi
from starlette.exceptions import HTTPException
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route as PlainRoute

from drivecomm.errors import DriveCommError
from drivecomm.server.http import answers, commanding, history_routes, problems, reading  # noqa: F401 - which add their routes
from drivecomm.server.http.guard import guarded
from drivecomm.server.http.page_files import files_of
from drivecomm.server.http.route import ROUTES, json_answer
from drivecomm.version import __version__

if TYPE_CHECKING:
    from collections.abc import Callable

    from starlette.requests import Request
    from starlette.types import ASGIApp, Scope

    from drivecomm.server.http.route import HttpDoorState


def application(door: HttpDoorState, check_place: Callable[[Scope], None]) -> ASGIApp:
    """Return the ASGI application of a door. check_place: raises HTTPException for a forbidden origin."""
    file = files_of("drivecomm.server.http")

    async def described(_: Request) -> Response:
        # In a thread, because the first call is slow.
        return json_answer(await asyncio.to_thread(description, local=door.local))

    async def health(_: Request) -> Response:
        return PlainTextResponse("ok\n")

    async def readiness(_: Request) -> Response:
        lines = door.plant.lines()
        if closed := sum(not line.up for line in lines):
            return PlainTextResponse(f"{closed} of {len(lines)} lines are not open\n", 503)
        return PlainTextResponse("ready\n")

    app = FastAPI(
        openapi_url=None,
        telemetry={"tracing": False, "metrics": False, "logs": False},
        exception_handlers={
            RequestValidationError: problems.not_understood,
            HTTPException: problems.refused,
            DriveCommError: problems.failed,
            Exception: problems.broken,
        },
    )
    app.state.door = door
    app.router.routes += [
        *ROUTES,
        PlainRoute("/openapi.json", described),
        PlainRoute("/healthz", health),
        PlainRoute("/readyz", readiness),
        PlainRoute("/page/{path:path}", file),
        PlainRoute("/", file),
    ]
    return guarded(app, check_place, problems.http_error_response)


@cache
def description(*, local: bool) -> dict[str, Any]:
    """Return the OpenAPI description of the local door, or of a network door, which has fewer routes and fields."""
    described = get_openapi(
        title="drivecomm",
        version=__version__,
        description="A plant of frequency converters, as its server knows it.",
        routes=[each for each in ROUTES if local or not each.local],
    )
    problem = answers.Problem.model_json_schema(ref_template="#/components/schemas/{model}")
    schemas = described["components"]["schemas"] | {"Problem": problem, **problem.pop("$defs")}
    for schema in () if local else schemas.values():
        fields = schema.get("properties", {})
        if needed := [name for name, each in fields.items() if each.pop("x-network", False)]:
            schema["required"] = needed
        schema["properties"] = {name: each for name, each in fields.items() if "x-local" not in each}
    described["components"] = {"schemas": schemas, "securitySchemes": {"token": {"type": "http", "scheme": "bearer"}}}
    return {**described, "security": [{"token": []}]}
