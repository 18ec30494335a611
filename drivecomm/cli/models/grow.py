"""The command that grows a model from a drive."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from drivecomm.cli.line_options import LineOptions
from drivecomm.cli.output import emit, progress_bar, say
from drivecomm.commissioning import addresses_in, descriptions, grown
from drivecomm.errors import DriveCommError, DriveError, UsageError
from drivecomm.models import load_model, model_text
from drivecomm.protocol import ParameterInfo, installed, parse_options

# As many as fit below each other on a screen; the others are counted.
_MOST_SHOWN = 10


def grow(
    drive: Annotated[str, typer.Argument(metavar="DRIVE", help="PROTOCOL:ADDRESS, such as danfoss-fc:3.")],
    line: LineOptions,
    write: Annotated[Path, typer.Option("--write", "-w", metavar="FILE", help="The model file to write.")],
    parameters: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[PARAM or FIRST..LAST]...",
            help="Such as 3-41 or 16-10..16-18. Default: all of its model, or of the protocol's usual one.",
        ),
    ] = None,
    model: Annotated[
        str | None, typer.Option("--model", "-m", help="The model to start from; common names come from there.")
    ] = None,
    option: Annotated[
        list[str] | None,
        typer.Option("--option", "-o", metavar="NAME=VALUE", help="Option of this protocol's describe."),
    ] = None,
) -> int:
    """Write a model file from what a drive reports of its parameters: names, types, units, scales, limits, texts.

    Only for protocols whose drives report it. Changes nothing in the drive. Exit code 5 when it reports nothing.
    """
    if write.suffix != ".toml":
        raise UsageError(f"a model file ends in .toml; write --write {write.with_suffix('.toml')}")
    if write.exists():
        raise UsageError(f"{write} already exists; name another file, or remove it")
    if not write.parent.is_dir():
        raise UsageError(f"there is no folder {write.parent} for the model; create it first")
    reached, name = line.reaching(drive)
    with reached.bus() as bus:
        one = name.with_options(**({"model": model} if model else {})).build(bus.drive)
        if not parameters:
            plugin = installed[name.protocol]
            parameters = list((one.model or load_model(plugin.package, plugin.name, plugin.default_model)).parameters)
        addresses = addresses_in(parameters)
        told: list[ParameterInfo] = []
        left_out: list[tuple[str, DriveCommError]] = []
        with progress_bar("asking", shown=not line.json) as progress:
            for done, (address, found) in enumerate(descriptions(one, addresses, parse_options(option or [])), 1):
                progress(address, done, len(addresses))
                if isinstance(found, ParameterInfo):
                    told.append(found)
                else:
                    left_out.append((address, found))
        source = f"what {one.name} told of itself"
        made = grown(
            told,
            protocol=name.protocol,
            name=write.stem,
            title=f"{one.model.title} as {one.name} describes itself" if one.model else f"{one.name} by its own word",
            source=source,
            base=one.model,
        )
    if not told:
        raise DriveError(f"{one.name} tells nothing of {len(addresses)} parameters, so there is no model to write")
    write.write_text(model_text(made), encoding="utf-8")
    if line.json:
        emit(
            drive=one.name,
            file=str(write),
            parameters=len(made.parameters),
            left_out=[{"parameter": address, "reason": str(reason)} for address, reason in left_out],
        )
        return 0
    say(f"{one.name}  {len(made.parameters)} parameters written to {write}")
    for _, reason in left_out[:_MOST_SHOWN]:
        say(f"  left out: {reason}")
    if len(left_out) > _MOST_SHOWN:
        say(f"  left out: {len(left_out) - _MOST_SHOWN} more")
    return 0
