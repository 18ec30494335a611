"""Commands without a port: `protocols`, `encode` and `decode`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import click

from drivecomm.capture import bytes_of
from drivecomm.cli import options
from drivecomm.cli.commands import NEGATIVE_NUMBERS, CliCommand
from drivecomm.cli.decode_log import decode_log
from drivecomm.cli.output import complain, emit, note, say, tell
from drivecomm.cli.values import FILE, OneOf
from drivecomm.errors import TelegramError, UsageError
from drivecomm.link import fields_text, likely_damage, telegrams_among_noise
from drivecomm.models import model_names
from drivecomm.protocol import (
    Direction,
    Framed,
    Telegram,
    decode as decode_telegram,
    encode as encode_telegram,
    installed,
    parse_options,
    protocol_options,
)

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from drivecomm.protocol import Codec


@click.command(cls=CliCommand)
@click.argument("protocol", shell_complete=options.complete_protocol, help="The protocol of the telegram.")
@click.argument(
    "fields",
    metavar="NAME=VALUE...",
    nargs=-1,
    required=True,
    help="Fields as decode shows them, such as kind=enquiry.",
)
@click.option(
    "--direction", "-d", type=OneOf(("request", "reply")), default="request", help="To the drive, or from it."
)
@options.protocol_option
@options.json
def encode(
    *,
    protocol: str,
    fields: tuple[str, ...],
    direction: Literal["request", "reply"],
    option: tuple[str, ...],
    json: bool,
) -> int:
    """Build one telegram from its fields and print it in hexadecimal."""
    written = dict(_pair(text) for text in fields)
    given = {name: _field(value) for name, value in written.items()}
    data = _encoded(protocol, direction, given, written, parse_options(option))
    tell(data.hex(" ").upper(), as_json=json, protocol=protocol, direction=direction, data=data, fields=given)
    return 0


def _encoded(
    protocol: str, direction: Direction, given: dict[str, Any], written: dict[str, str], options: dict[str, Any]
) -> bytes:
    """Encode a telegram; retry a refused number as text, since VABus data 1234 are four characters."""
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
    """Return a field's value in the type that vectors use: number, list, boolean or text."""
    if value.startswith("[") and value.endswith("]"):
        return [int(part, 0) for part in value[1:-1].split(",")]
    if value.lower() in ("true", "false"):
        return value.lower() == "true"
    try:
        return int(value, 0)
    except ValueError:
        return value


@click.command(cls=CliCommand, context_settings=NEGATIVE_NUMBERS)
@click.argument("data", nargs=-1, help="The telegram in hexadecimal, with any spacing.")
@click.option("--log", type=FILE, help="A log that another program printed, instead of one telegram.")
@click.option(
    "--protocol", metavar="PROTOCOL", shell_complete=options.complete_protocol, help="Default: all installed ones."
)
@click.option("--direction", "-d", type=OneOf(("request", "reply")), help="Default: both.")
@options.protocol_option
@options.json
def decode(
    *,
    data: tuple[str, ...],
    log: Path | None,
    protocol: str | None,
    direction: Literal["request", "reply"] | None,
    option: tuple[str, ...],
    json: bool,
) -> int:
    """Decode one telegram, or the telegrams of a log. Without --protocol, find the installed protocols that they fit.

    Telegrams among noise bytes are named, too. Bytes that are almost a telegram are refused with the likely damage, and
    lines of a log that cannot be read with the reason.
    """
    names = [protocol] if protocol else [plugin.name for plugin in installed.working()]
    options = parse_options(option)
    if bool(data) == (log is not None):
        raise UsageError("decode takes the bytes of one telegram, or a log with --log FILE; give one of them")
    if log is not None:
        if direction is not None:
            raise UsageError("--direction is for one telegram; the lines of a log say who sent them")
        return decode_log(log, _codecs(names, options), as_json=json)
    content = bytes_of(" ".join(data))
    ways: list[Direction] = [direction] if direction else ["request", "reply"]
    fits: list[Telegram] = []
    refusals: list[tuple[str, Direction, TelegramError]] = []
    for name in names:
        for way in ways:
            try:
                fits.append(decode_telegram(name, content, direction=way, **options))
            except TelegramError as refusal:
                refusals.append((name, way, refusal))
    for telegram in fits:
        _show(telegram, as_json=json)
    if fits:
        return 0
    codecs = _codecs(names, options)
    among_noise = [_show_among_noise(name, codecs[name], way, content, as_json=json) for name, way, _ in refusals]
    if any(among_noise):
        return 0
    for name, way, error in refusals:
        damage = likely_damage(content, codecs[name], way)
        likely = f"; probably {damage.cause}: {damage.remedy}" if damage else ""
        text = f"{name} {way}: refused ({error.category}): {error}{likely}"
        why = {"category": error.category, "reason": str(error)}
        if damage is not None:
            why |= {"damage": damage.cause, "remedy": damage.remedy}
        tell(text, as_json=json, protocol=name, direction=way, valid=False, **why)
    note("these bytes are not a telegram of the protocols tried")
    return TelegramError.exit_code


def _codecs(names: Sequence[str], options: dict[str, Any]) -> dict[str, Codec]:
    return {name: installed[name].codec(protocol_options(installed[name], options)) for name in names}


def _show(telegram: Telegram, *, as_json: bool) -> None:
    text = f"{telegram.protocol} {telegram.direction}: {fields_text(telegram.message)}"
    found = {"protocol": telegram.protocol, "direction": telegram.direction, "valid": True}
    tell(text, as_json=as_json, **found, data=telegram.data, fields=telegram.fields)


def _show_among_noise(name: str, codec: Codec, way: Direction, content: bytes, *, as_json: bool) -> bool:
    """Print the telegrams of a protocol among noise bytes; return False if there are none."""
    finds = telegrams_among_noise(content, codec, way)
    for find in finds:
        if isinstance(find, Framed):
            _show(Telegram(protocol=name, direction=way, data=find.data, message=find.message), as_json=as_json)
        else:
            text = f"{'':<{len(name)}} noise: {find.data.hex(' ').upper()}"
            tell(text, as_json=as_json, protocol=name, direction=way, noise=find.data)
    return bool(finds)


@click.command(cls=CliCommand)
@options.json
def protocols(*, json: bool) -> int:
    """List the installed protocols with their defaults and models."""
    broken = installed.broken()
    for name in installed:
        if name in broken:
            complain(broken[name], as_json=json)
            continue
        plugin = installed[name]
        facts = plugin.facts
        if json:
            emit(
                protocol=name,
                title=plugin.title,
                addresses=[plugin.addresses[0], plugin.addresses[-1]],
                broadcast=plugin.broadcast_address,
                line=str(facts.settings),
                reply_timeout_s=facts.timing.reply_timeout_s,
                models=model_names(plugin.package, plugin.name),
                parameters=list(plugin.parameter_examples),
            )
            continue
        span = f"{plugin.addresses[0]}-{plugin.addresses[-1]}"
        say(f"{name:<11} {plugin.title}")
        say(f"{'':<11} addresses {span}, {facts.settings}, parameters like {', '.join(plugin.parameter_examples)}")
        say(f"{'':<11} models {', '.join(model_names(plugin.package, plugin.name)) or 'none'}")
    return 2 if broken else 0
