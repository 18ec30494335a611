"""Reference of the HTTP API, made from the OpenAPI description of a server."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from markdown_tables import code, table

from drivecomm.server.http import description

if TYPE_CHECKING:
    from collections.abc import Iterator

_JSON = "application/json"
_INTRODUCTION = """\
Requests that a server accepts at its local door and over HTTP; this page is made from the models that check requests.
A running server describes the same as OpenAPI 3.1 at `/openapi.json`; `/metrics` is for Prometheus.
`/healthz` says that the process is running, `/readyz` that all lines are open.

Requests and responses are JSON. Numbers keep their digits: 10.00 is not 10.0.
The header `Authorization: Bearer TOKEN` identifies the caller.
A request that is not carried out gets [problem details](https://www.rfc-editor.org/rfc/rfc9457).
`detail` is the message, `error` the error that Python callers get.
For a command they also have its `id`, its `outcome` and its `result`, and the status gives the reason:

| outcome | status |
|---|---|
| `done` | 200 |
| `refused`, the caller may not | 403 |
| `refused`, another caller has the drive, the lease has expired, or a stop came first | 409 |
| `refused`, the verb or its arguments are invalid | 422 |
| `refused`, too many requests | 429 |
| `refused`, the server cannot, for example because there is no space for its audit | 503 |
| `failed`: the drive refused, or a read failed | 502 |
| `open`: it was sent, and the drive may or may not have acted | 504 |

Nothing was sent for a refused command.
So `curl --fail`, Node-RED and other plain HTTP clients never take a failure for success.
A status alone never says that a motor has stopped: after a 504 the server retries a stop until the drive confirms it.
`POST /api/v1/stop` stops many drives and always answers 200, with an outcome for each.

Access protection is described on the [security checklist](security-checklist.md)."""


def http_api_page() -> str:
    """Return the page as Markdown."""
    described = description(local=True)
    operations = [
        (method.upper(), path, operation)
        for path, methods in described["paths"].items()
        for method, operation in methods.items()
    ]
    parts = [
        "# HTTP API",
        _INTRODUCTION,
        table(
            ("request", "purpose"),
            (
                (f"[`{method} {path}`](#{_anchor(method, path)})", operation["summary"])
                for method, path, operation in operations
            ),
        ),
    ]
    for method, path, operation in operations:
        parts += _section(method, path, operation, described["components"]["schemas"])
    parts.append("## Responses")
    schemas = described["components"]["schemas"]
    for name in sorted(schemas.keys() - {_name(_body(operation)) for _, _, operation in operations}):
        parts += _answer(name, schemas[name])
    return "\n\n".join(parts) + "\n"


def _section(method: str, path: str, operation: dict[str, Any], schemas: dict[str, Any]) -> Iterator[str]:
    yield f"## {method} {path} {{ #{_anchor(method, path)} }}"
    forms = operation["responses"]["200"]["content"].items()
    answers = " or ".join(_type(each["schema"]) if form == _JSON else code(form) for form, each in forms)
    yield f"{operation['summary']} {operation['description']} Response: {answers}."
    given = [
        (each["name"], each["in"], each["schema"], each["description"], each["required"])
        for each in operation.get("parameters", ())
    ]
    body = schemas.get(_name(_body(operation)), {})
    needed = body.get("required", ())
    for name, schema in body.get("properties", {}).items():
        local = "; local door only" if "x-local" in schema else ""
        network = "; needed on network doors" if "x-network" in schema else ""
        given.append((name, "body", schema, f"{schema['description']}{local}{network}", name in needed))
    if given:
        yield table(
            ("name", "in", "type", "needed", "meaning"),
            ((code(name), at, _type(schema), "yes" if must else "", what) for name, at, schema, what, must in given),
        )


def _body(operation: dict[str, Any]) -> dict[str, Any]:
    body: dict[str, Any] = operation.get("requestBody", {}).get("content", {}).get(_JSON, {}).get("schema", {})
    return body


def _name(schema: dict[str, Any]) -> str:
    return str(schema.get("$ref", "")).rpartition("/")[2]


def _answer(name: str, schema: dict[str, Any]) -> Iterator[str]:
    yield f"### {name}"
    if "description" in schema:
        yield schema["description"]
    if properties := schema.get("properties"):
        yield table(("field", "type"), ((code(key), _type(each)) for key, each in properties.items()))
    elif schema.get("type") == "array":
        yield f"A list of {_type(schema['items'])}."
    else:
        yield f"{_type(schema)}."


def _type(schema: dict[str, Any]) -> str:
    if "$ref" in schema:
        return f"[{_name(schema)}](#{_name(schema).lower()})"
    if "anyOf" in schema:
        return " or ".join(_type(each) for each in schema["anyOf"])
    if "enum" in schema:
        return ", ".join(code(each) for each in schema["enum"])
    if schema.get("type") == "array":
        return f"list of {_type(schema['items'])}" if "items" in schema else "list"
    low, high = schema.get("minimum"), schema.get("maximum")
    limits = "".join(f" {word} {at:g}" for word, at in (("from", low), ("to", high)) if at is not None)
    return schema.get("type", "anything") + limits


def _anchor(method: str, path: str) -> str:
    words = [word.strip("{}") for word in path.split("/") if word not in ("", "api", "v1")]
    return "-".join([method.lower(), *words])
