"""The backup command."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from drivecomm.cli.line_options import LineOptions
from drivecomm.cli.options import Drive, Model
from drivecomm.cli.output import emit, say
from drivecomm.cli.parameter_sets.drive_of_set import drive_of_set
from drivecomm.cli.progress import progress_bar
from drivecomm.commissioning.parameter_sets import back_up, must_be_free, write_set

if TYPE_CHECKING:
    from drivecomm.commissioning.parameter_sets import Part


def backup(
    drive: Drive,
    file: Annotated[Path, typer.Argument(metavar="FILE", help="TOML file; an existing one is replaced.")],
    line: LineOptions,
    model: Model = None,
    everything: Annotated[bool, typer.Option("--all", help="Also measured values, which are never restored.")] = False,
) -> int:
    """Save the parameters of a drive to a file. What cannot be read is listed in it."""
    _, name = line.reaching(drive)
    must_be_free(file, str(name))
    parts: list[Part] = ["settings", "communication", *(["measured"] if everything else [])]  # type: ignore[list-item]
    with drive_of_set(line, drive, model) as one, progress_bar("reading", shown=not line.json) as progress:
        found = back_up(one, parts, progress=progress)
    write_set(file, found)
    if line.json:
        emit(**name.labels, model=found.model, file=str(file), parameters=len(found.entries),
             not_read=dict(found.not_read))  # fmt: skip
        return 0
    for address, reason in found.not_read.items():
        say(f"{name.name}  {address}  not read: {reason}")
    say(f"{name.name}  {len(found.entries)} parameters in {file}")
    return 0
