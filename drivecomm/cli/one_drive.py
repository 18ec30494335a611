"""What the commands for one drive have in common: how they read values, and print what was read or done."""

from __future__ import annotations

from decimal import Decimal, InvalidOperation
from typing import TYPE_CHECKING, Any

from drivecomm.cli.output import emit, plain, say
from drivecomm.errors import UsageError
from drivecomm.protocol import parse_options

if TYPE_CHECKING:
    from drivecomm.cli.line_options import LineOptions
    from drivecomm.protocol import DriveConfig, Reading


def verb_options(type: str | None, further: list[str] | None) -> dict[str, Any]:
    """Return the options of a read or write. Raises UsageError."""
    return {**parse_options(further or []), **({"type": type} if type else {})}


def number(text: str | None) -> Decimal | None:
    """Return a number as it is written, None for none. Raises UsageError."""
    if text is None:
        return None
    try:
        return Decimal(text.strip().removesuffix("%").strip())
    except InvalidOperation:
        raise UsageError(f"{text!r} is not a number") from None


def show_reading(drive: DriveConfig, parameter: str, reading: Reading, *, as_json: bool) -> None:
    """Print a value that was read. parameter: as it was asked for."""
    if as_json:
        told = {**plain(reading), "parameter": parameter, "address": reading.parameter, "quantity": reading.name}
        emit(**{**drive.labels, **told, "name": drive.name})
        return
    name = f"{reading.parameter} {reading.name}".rstrip()
    note = f"  [{reading.note}]" if reading.note else ""
    say(f"{drive.name}  {name:<34} {reading!s:>14}{note}".rstrip())


def done(drive: DriveConfig, line: LineOptions, what: str, *, result: object = None) -> None:
    """Print what was done with a drive."""
    if line.json:
        emit(**drive.labels, done=what, result=result)
        return
    say(f"{drive.name}  {what}" + (f": {result}" if result is not None else ""))
