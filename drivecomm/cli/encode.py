"""The encode command: one telegram from its fields, without a port."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import typer

from drivecomm.cli.options import Json, ProtocolOption
from drivecomm.cli.output import emit, say
from drivecomm.errors import TelegramError, UsageError
from drivecomm.protocol import Direction, encode as encode_telegram, parse_options


def encode(
    protocol: Annotated[str, typer.Argument(help="Which protocol.")],
    fields: Annotated[
        list[str], typer.Argument(metavar="NAME=VALUE...", help="Fields as decode shows them, such as kind=enquiry.")
    ],
    direction: Annotated[
        Literal["request", "reply"], typer.Option("--direction", "-d", help="To the drive, or from it.")
    ] = "request",
    option: ProtocolOption = None,
    json: Json = False,
) -> int:
    """Build one telegram from its fields and print it in hexadecimal."""
    written = dict(_pair(text) for text in fields)
    given = {name: _field(value) for name, value in written.items()}
    data = _encoded(protocol, direction, given, written, parse_options(option or []))
    if json:
        emit(protocol=protocol, direction=direction, data=data, fields=given)
    else:
        say(data.hex(" ").upper())
    return 0


def _encoded(
    protocol: str, direction: Direction, given: dict[str, Any], written: dict[str, str], options: dict[str, Any]
) -> bytes:
    """Encode; a field that is refused as a number is tried as text, for VABus data 1234 are four characters."""
    try:
        return encode_telegram(protocol, given, direction=direction, **options)
    except TelegramError as error:
        if not isinstance(given.get(error.field), int):
            raise
        given[error.field] = written[error.field]
        return _encoded(protocol, direction, given, written, options)


def _pair(text: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not equals:
        raise UsageError(f"{text!r} is not a field; write name=value")
    return name, value


def _field(value: str) -> Any:
    """Return a field's value in the type that vectors give it: numbers for numbers, text for texts."""
    if value.startswith("[") and value.endswith("]"):
        return [int(part, 0) for part in value[1:-1].split(",")]
    if value.lower() in ("true", "false"):
        return value.lower() == "true"
    try:
        return int(value, 0)
    except ValueError:
        return value
