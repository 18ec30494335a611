"""The description of the API by OpenAPI 3.1, made from the table by which requests are checked."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from drivecomm.server import NEEDS, Role
from drivecomm.server.http.fields import LONGEST_TEXT, OBJECT, TEXT, TEXTS, WHOLES, Field
from drivecomm.server.http.routes import ROUTES
from drivecomm.server.http.schemas import SCHEMAS
from drivecomm.version import __version__

if TYPE_CHECKING:
    from drivecomm.server.http.routes import Route

_FORMS = {
    "json": "application/json",
    "events": "text/event-stream",
    "lines": "application/x-ndjson",
    "text": "text/plain",
}
_NAMED = {
    "name": "the drive's name in the plant",
    "line": "the line's name in the plant",
    "drive": "PROTOCOL:ADDRESS",
    "verb": "what to do",
    "id": "the alarm's id",
}
_FAILURE = {
    "description": "It was not understood, or may not be: 401, 403, 404, 405, 408, 409, 413, 422, 429, 500, 503.",
    "content": {"application/json": {"schema": {"$ref": "#/components/schemas/Failure"}}},
}


def description(*, local: bool) -> dict[str, Any]:
    """Return the description of the local door, or of a door to a network, which has fewer routes and fields."""
    paths: dict[str, dict[str, Any]] = {}
    for route in ROUTES:
        if local or not route.local:
            paths.setdefault(route.path, {})[route.method.lower()] = _operation(route, local=local)
    return {
        "openapi": "3.1.0",
        "info": {
            "title": "drivecomm",
            "version": __version__,
            "description": "A plant of frequency converters, as its server knows it.",
        },
        "paths": paths,
        "components": {
            "schemas": dict(SCHEMAS),
            "securitySchemes": {"token": {"type": "http", "scheme": "bearer"}},
        },
        "security": [{"token": []}],
    }


def _operation(route: Route, *, local: bool) -> dict[str, Any]:
    parameters = [
        {"name": name, "in": "path", "required": True, "description": _NAMED[name], "schema": _named(name)}
        for name in re.findall(r"{(\w+)}", route.path)
    ]
    parameters += [
        {"name": name, "in": "query", "required": field.needed, "description": field.about, "schema": schema_of(field)}
        | ({"style": "form", "explode": False} if field.kind is TEXTS else {})
        for name, field in route.query.items()
    ]
    made: dict[str, Any] = {
        "operationId": route.carry_out.__name__,
        "summary": route.summary,
        "description": who(route),
        "parameters": parameters,
        "responses": {
            "200": {
                "description": route.answer,
                "content": {_FORMS[route.form]: {"schema": {"$ref": f"#/components/schemas/{route.answer}"}}},
            },
            "default": _FAILURE,
        },
    }
    fields = {name: field for name, field in route.body.items() if local or not field.local}
    if fields:
        body = {
            "type": "object",
            "properties": {name: schema_of(field) | {"description": about(field)} for name, field in fields.items()},
            "required": [name for name, field in fields.items() if field.needed or (field.network and not local)],
            "additionalProperties": False,
        }
        needed = bool(body["required"])
        made["requestBody"] = {"required": needed, "content": {"application/json": {"schema": body}}}
    if route.role is Role.NOBODY:
        made["security"] = []
    return made


def schema_of(field: Field) -> dict[str, Any]:
    """Return the JSON Schema of a field of a request."""
    made: dict[str, Any] = {"type": field.kind.schema}
    if field.kind is TEXT:
        made["maxLength"] = LONGEST_TEXT
    if field.kind in (TEXTS, WHOLES):
        made["items"] = {"type": "string" if field.kind is TEXTS else "integer"}
    if field.kind is OBJECT:
        # Otherwise some generators of clients take it for an object without anything in it.
        made["additionalProperties"] = True
    limits = {"minimum": field.low, "maximum": field.high}
    made |= {key: limit for key, limit in limits.items() if limit is not None}
    return made | ({"enum": list(field.choices)} if field.choices else {})


def about(field: Field) -> str:
    """Return what a field is, and who must give it, or may."""
    if field.local:
        return f"{field.about}; local door only"
    return f"{field.about}; needed on network doors" if field.network else field.about


def who(route: Route) -> str:
    """Return who may ask this, as a sentence."""
    if route.role is Role.NOBODY:
        return "For everybody."
    where = " of the local door" if route.local else ""
    named = "" if route.named else ", and for anonymous ones where the door lets them view"
    return f"For callers{where} with the role {route.role.name.lower()} or more{named}."


def _named(name: str) -> dict[str, Any]:
    return {"type": "string", "enum": sorted(NEEDS)} if name == "verb" else {"type": "string"}
