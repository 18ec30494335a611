"""Routes of the API. The caller's rights are checked before the rest of a request is read."""

from __future__ import annotations

import asyncio
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeVar

from fastapi.routing import APIRoute
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, Response, StreamingResponse
from starlette.routing import Match

from drivecomm.client import json_text, parsed, plain
from drivecomm.errors import unknown_key
from drivecomm.server import ANONYMOUS, Caller, Role
from drivecomm.server.http.fields import LOCAL, LONGEST_TEXT, NETWORK
from drivecomm.server.http.guard import whole_body

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Coroutine, Mapping, Sequence

    from pydantic.fields import FieldInfo
    from starlette.types import Receive, Scope, Send

    from drivecomm.server import ServedPlant
    from drivecomm.server.http.callers import Callers
    from drivecomm.server.http.guard import LoginRate
    from drivecomm.server.http.metrics import Metrics
    from drivecomm.server.http.stream import Streams

T = TypeVar("T", bound="Callable[..., Any]")

V1 = "/api/v1"
_FAILURE: Any = {
    "description": "Invalid, forbidden, or not carried out: 400, 401, 403, 404, 405, 408, 409, 413, 422, "
    "429, 500, 502, 503, 504.",
    "content": {"application/problem+json": {"schema": {"$ref": "#/components/schemas/Problem"}}},
}


@dataclass(frozen=True, slots=True, kw_only=True)
class HttpDoorState:
    """State of one open door. local: whether it is the local door. readers: limits parallel reads of the history."""

    plant: ServedPlant
    streams: Streams
    logins: LoginRate
    metrics: Metrics
    callers: Callers
    local: bool
    rendering: asyncio.Lock = field(default_factory=asyncio.Lock)
    readers: asyncio.Semaphore = field(default_factory=lambda: asyncio.Semaphore(2))


class ApiRequest(Request):
    """Request of a caller who may use the route. fields: fields that its body may have."""

    caller: Caller
    fields: Mapping[str, FieldInfo]

    @property
    def door(self) -> HttpDoorState:
        """The door that received the request."""
        return self.app.state.door  # type: ignore[no-any-return]

    @property
    def plant(self) -> ServedPlant:
        """The served plant."""
        return self.door.plant

    async def body(self) -> bytes:
        """Return a dummy, so that FastAPI calls `json`, which reads the real body whatever its content type."""
        return b"{}"

    async def json(self) -> dict[str, Any]:
        """Return the fields of the body that are not null; an empty body has no fields. Raises HTTPException."""
        try:
            content = parsed((await whole_body(self)).strip() or b"{}")
        except (ValueError, ArithmeticError, RecursionError):
            raise HTTPException(400, "the body is not JSON") from None
        if not isinstance(content, dict):
            raise HTTPException(422, "the body is not a JSON object; give it in braces")
        check_names(content, self.fields, local=self.door.local)
        return {name: value for name, value in content.items() if value is not None}


def check_names(given: Mapping[str, Any], fields: Mapping[str, FieldInfo], *, local: bool) -> None:
    """Raise HTTPException for a field that this route or door does not accept, or for a missing required field."""
    for name in given:
        if name not in fields:
            raise HTTPException(422, unknown_key(name[:LONGEST_TEXT], fields))
        if not local and fields[name].json_schema_extra == LOCAL:
            raise HTTPException(403, f"{name} is for callers of the local door only")
    for name, each in fields.items():
        if not local and each.json_schema_extra == NETWORK and given.get(name) is None:
            raise HTTPException(422, f"the field {name!r} is missing; give {each.description}")


class EventStream(Response):
    """Endless response, ended by the client or by the door. serve: sends the stream."""

    media_type = "text/event-stream"

    def __init__(self, serve: Callable[[Scope, Receive, Send], Awaitable[None]], status_code: int = 200) -> None:
        super().__init__(status_code=status_code)
        self._serve = serve

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send the stream."""
        await self._serve(scope, receive, send)


class Lines(StreamingResponse):
    """Response of one JSON object per line, sent as each becomes available."""

    media_type = "application/x-ndjson"


class Route(APIRoute):
    """Route of the API, as registered by `route`."""

    def __init__(
        self, path: str, endpoint: Callable[..., Any], role: Role, named: bool, local: bool, **how: Any
    ) -> None:
        self.role, self.named, self.local = role, named, local
        how |= {"summary": endpoint.__doc__, "description": self._who(), "operation_id": endpoint.__name__}
        super().__init__(path, endpoint, **how, openapi_extra=None if role else {"security": []})
        self._query = {each.alias: each.field_info for each in self.dependant.query_params}

    def matches(self, scope: Scope) -> tuple[Match, Scope]:
        """Match a request against this route. A GET route also serves HEAD unless its response is endless."""
        if not self.path_regex.match(scope["path"]):
            # Most routes do not match, and FastAPI needs ten times as long to find that out.
            return Match.NONE, {}
        if scope["method"] != "HEAD" or self.response_class in (EventStream, Lines):
            return super().matches(scope)
        found, child = super().matches({**scope, "method": "GET"})
        return found, {**child, "method": "GET", "is_head": True} if found is Match.FULL else child

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """Return a handler that checks the caller before FastAPI reads the request."""
        carry_out = super().get_route_handler()
        model: Any = self.body_field and self.body_field.field_info.annotation
        fields = model.model_fields if model else {}

        async def handle(request: Request) -> Response:
            # Every body is parsed as JSON, whatever its content type.
            headers = [each for each in request.scope["headers"] if each[0] != b"content-type"]
            headers.append((b"content-type", b"application/json"))
            asked = ApiRequest({**request.scope, "headers": headers}, request.receive)
            request.scope["state"]["standing"].streams = self.response_class is EventStream
            asked.caller, asked.fields = self._caller(asked), fields
            given = Counter(name for name, _ in asked.query_params.multi_items())
            check_names(given, self._query, local=asked.door.local)
            if twice := [name for name in given if given[name] > 1 and name != "drives"]:
                raise HTTPException(422, f"the query gives {twice[0]!r} twice")
            return await carry_out(asked)

        return handle

    def _caller(self, asked: ApiRequest) -> Caller:
        caller = asked.door.callers.of(asked.scope)
        if caller is not None and caller.name != ANONYMOUS:
            asked.scope["state"]["standing"].known = True
        if self.role is not Role.NOBODY:
            if caller is None or (self.named and caller.name == ANONYMOUS):
                text = "give the token of a permitted user: Authorization: Bearer TOKEN"
                raise HTTPException(401, text, {"WWW-Authenticate": "Bearer"})
            if caller.role < self.role:
                text = f"{caller} has the role {caller.role.name.lower()}; this needs {self.role.name.lower()}"
                raise HTTPException(403, text)
        if self.local and not asked.door.local:
            raise HTTPException(403, "this is for callers of the local door only")
        return caller or Caller(name=ANONYMOUS, role=Role.NOBODY, door="")

    def _who(self) -> str:
        if self.role is Role.NOBODY:
            return "For everybody."
        where = " of the local door" if self.local else ""
        named = "" if self.named else ", and for anonymous ones where the door lets them view"
        return f"For callers{where} with the role {self.role.name.lower()} or more{named}."


def json_answer(content: object) -> Response:
    """Return a JSON response with this content."""
    return Response(json_text(plain(content)), media_type="application/json")


ROUTES: list[Route] = []
"""All routes, in the order in which they are matched."""


def route(
    method: str,
    path: str,
    answer: Any = None,
    *,
    role: Role = Role.VIEW,
    named: bool = False,
    local: bool = False,
    form: type[Response] = JSONResponse,
    others: Sequence[str] = (),
) -> Callable[[T], T]:
    """Return a decorator that registers an endpoint.

    answer: model of the response. role: least role of the caller; NOBODY needs no role and no name. named: excludes
    anonymous callers. local: only for callers of the local door. form: response class. others: further content types of
    the response.
    """

    def add(endpoint: T) -> T:
        content = {each: {"schema": {"type": "string"}} for each in others}
        responses: Any = {200: {"content": content}, "default": _FAILURE}
        how: Any = {"methods": [method], "response_model": answer, "response_class": form, "responses": responses}
        ROUTES.append(Route(path, endpoint, role, named, local, **how))
        return endpoint

    return add
