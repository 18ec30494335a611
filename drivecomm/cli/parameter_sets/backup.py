"""The backup command, and the drives whose parameters are saved, compared or restored."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from drivecomm.cli.line_options import LineOptions
from drivecomm.cli.options import Drive, Model
from drivecomm.cli.output import emit, progress_bar, say
from drivecomm.commissioning.parameter_sets import back_up, must_be_free, write_set

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivecomm import bus
    from drivecomm.commissioning.parameter_sets import ParameterSet, Part


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


SetModel = Annotated[
    str | None, typer.Option("--model", "-m", help="Model name, or a .toml file; that of the set if absent.")
]
Communication = Annotated[
    bool, typer.Option("--communication", help="Include communication settings: address, baud rate and the like.")
]


@contextmanager
def drive_of_set(
    line: LineOptions, text: str, model: str | None, known: ParameterSet | None = None
) -> Iterator[bus.Drive]:
    """Open the line of a drive and yield it. known: a set whose model is used where none is given."""
    reached, name = line.reaching(text)
    of_set = {"model": known.model} if known and known.model and known.protocol == name.protocol else {}
    with reached.drive_at(replace(name, options={**of_set, **name.options}), model) as one:
        yield one
