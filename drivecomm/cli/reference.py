"""The reference command."""

from __future__ import annotations

from typing import Annotated

import typer

from drivecomm.cli.line_options import LineOptions
from drivecomm.cli.one_drive import done, number
from drivecomm.cli.options import Drive, Model
from drivecomm.errors import UsageError


def reference(
    drive: Drive,
    line: LineOptions,
    value: Annotated[str | None, typer.Argument(metavar="[VALUE]", help="With its unit: 50%, 25Hz or 1450rpm.")] = None,
    percent: Annotated[str | None, typer.Option(help="Percent of the reference range.")] = None,
    hz: Annotated[str | None, typer.Option(help="Output frequency in hertz.")] = None,
    rpm: Annotated[str | None, typer.Option(help="Speed, from the motor data in the drive.")] = None,
    model: Model = None,
) -> int:
    """Set the reference; it is never stored."""
    if value is not None:
        for flag, said in (("percent", percent), ("hz", hz), ("rpm", rpm)):
            if said is not None:
                raise UsageError(f"{value} and --{flag} {said} exclude each other; leave one of them out")
        figure, unit = _with_unit(value)
        percent, hz, rpm = (figure if unit == each else said for each, said in _units(percent, hz, rpm))
    with line.drive(drive, model) as (one, name):
        one.set_reference(percent=number(percent), hz=number(hz), rpm=number(rpm))
        done(name, line, *(f"reference {said} {unit}" for unit, said in _units(percent, hz, rpm) if said is not None))
    return 0


def _units(percent: str | None, hz: str | None, rpm: str | None) -> tuple[tuple[str, str | None], ...]:
    return ("%", percent), ("Hz", hz), ("rpm", rpm)


def _with_unit(value: str) -> tuple[str, str]:
    """Return the number and the unit of a reference such as 50%."""
    text = value.strip()
    for unit in ("%", "Hz", "rpm"):
        if text.lower().endswith(unit.lower()):
            return text[: -len(unit)], unit
    raise UsageError(f"{value!r} has no unit; write {value}%, {value}Hz or {value}rpm")
