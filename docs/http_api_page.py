"""The reference of the HTTP API, made from the description that a server gives of itself."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from markdown_tables import code, table

from drivecomm.server.http import description

if TYPE_CHECKING:
    from collections.abc import Iterator

_INTRODUCTION = """\
What a server answers, on its local door and over HTTP; made from the table by which it checks requests.
A running server gives the same as OpenAPI 3.1 at `/openapi.json`, and `/metrics` for Prometheus.
`/healthz` says that the process is there, `/readyz` that all lines are open.

Requests and answers are JSON. Numbers keep their digits: 10.00 is not 10.0.
Who asks is told by `Authorization: Bearer TOKEN`.
An answer to a command has status 200 whatever came of it; its `outcome` says what.
Other statuses come with `error`, as does a refused command.
What keeps strangers out is on the [security checklist](security-checklist.md)."""


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
        parts += _section(method, path, operation)
    parts.append("## Answers")
    for name, schema in described["components"]["schemas"].items():
        parts += _answer(name, schema)
    return "\n\n".join(parts) + "\n"


def _section(method: str, path: str, operation: dict[str, Any]) -> Iterator[str]:
    yield f"## {method} {path} {{ #{_anchor(method, path)} }}"
    answer = operation["responses"]["200"]["description"]
    yield f"{operation['summary']} {operation['description']} Answers [{answer}](#{answer.lower()})."
    given = [(each["name"], each["in"], each["schema"], each["description"]) for each in operation["parameters"]]
    body = operation.get("requestBody", {}).get("content", {}).get("application/json", {}).get("schema", {})
    given += [(name, "body", schema, schema["description"]) for name, schema in body.get("properties", {}).items()]
    needed = {each["name"] for each in operation["parameters"] if each["required"]}.union(body.get("required", ()))
    if given:
        yield table(
            ("name", "in", "type", "needed", "what it is"),
            (
                (code(name), place, _type(schema), "yes" if name in needed else "", what)
                for name, place, schema, what in given
            ),
        )


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
        name = schema["$ref"].rpartition("/")[2]
        return f"[{name}](#{name.lower()})"
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
