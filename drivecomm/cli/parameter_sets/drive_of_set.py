"""A drive whose parameters are saved, compared or restored."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivecomm.bus import Drive
    from drivecomm.cli.line_options import LineOptions
    from drivecomm.commissioning.parameter_sets import ParameterSet

SetModel = Annotated[
    str | None, typer.Option("--model", "-m", help="Model name, or a .toml file; that of the set if absent.")
]
Communication = Annotated[
    bool, typer.Option("--communication", help="Include communication settings: address, baud rate and the like.")
]


@contextmanager
def drive_of_set(line: LineOptions, text: str, model: str | None, known: ParameterSet | None = None) -> Iterator[Drive]:
    """Open the line of a drive and yield it. known: a set whose model is used where none is given."""
    reached, name = line.reaching(text)
    of_set = {"model": known.model} if known and known.model and known.protocol == name.protocol else {}
    with reached.drive_at(replace(name, options={**of_set, **name.options}), model) as one:
        yield one
