"""The decode command: one telegram, without a port."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from drivecomm.cli.options import Json, ProtocolOption
from drivecomm.cli.output import emit, say
from drivecomm.errors import TelegramError, UsageError
from drivecomm.link import fields_text
from drivecomm.protocol import Direction, decode as decode_telegram, installed, parse_options

if TYPE_CHECKING:
    from drivecomm.protocol import Telegram


def decode(
    data: Annotated[list[str], typer.Argument(help="The telegram in hexadecimal, with any spacing.")],
    protocol: Annotated[str | None, typer.Option("--protocol", help="Default: all installed ones.")] = None,
    direction: Annotated[
        Literal["request", "reply"] | None, typer.Option("--direction", "-d", help="Default: both.")
    ] = None,
    option: ProtocolOption = None,
    json: Json = False,
) -> int:
    """Decode one telegram. Without --protocol, find the installed protocols that it fits."""
    content = _bytes(data)
    names = [protocol] if protocol else [plugin.name for plugin in installed.working()]
    ways: list[Direction] = [direction] if direction else ["request", "reply"]
    fits: list[Telegram] = []
    refusals: list[tuple[str, Direction, TelegramError]] = []
    for name in names:
        for way in ways:
            try:
                fits.append(decode_telegram(name, content, direction=way, **parse_options(option or [])))
            except TelegramError as refusal:
                refusals.append((name, way, refusal))
    for telegram in fits:
        _show(telegram, as_json=json)
    if fits:
        return 0
    for name, way, error in refusals:
        if json:
            emit(protocol=name, direction=way, valid=False, category=error.category, reason=str(error))
        else:
            say(f"{name} {way}: refused ({error.category}): {error}")
    sys.stderr.write("drivecomm: these bytes are not a telegram of the protocols tried\n")
    return TelegramError.exit_code


def _show(telegram: Telegram, *, as_json: bool) -> None:
    if as_json:
        emit(
            protocol=telegram.protocol,
            direction=telegram.direction,
            valid=True,
            data=telegram.data,
            fields=telegram.fields,
        )
        return
    say(f"{telegram.protocol} {telegram.direction}: {fields_text(telegram.message)}")


def _bytes(words: list[str]) -> bytes:
    text = "".join("".join(words).split()).replace(":", "").replace(",", "").replace("-", "")
    text = text.replace("0x", "").replace("0X", "").replace("\\x", "")
    try:
        return bytes.fromhex(text)
    except ValueError:
        raise UsageError(f"{' '.join(words)!r} is not hexadecimal; write bytes such as 04 41 or 0441") from None
