"""The plot command: a log of values as a picture or a page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from drivecomm.cli.options import Json
from drivecomm.cli.output import counted, tell
from drivecomm.plant.value_log import read_rows
from drivecomm.plant.value_plots import picture_of, save


def plot(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="A file written by --log: .csv or .parquet.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="The file to write: .png, .svg or .html.")],
    drive: Annotated[list[str] | None, typer.Option("--drive", help="Only this drive; repeatable.")] = None,
    name: Annotated[list[str] | None, typer.Option("--name", help="Only this quantity; repeatable.")] = None,
    title: Annotated[str | None, typer.Option("--title", help="Title. Default: the name of the log.")] = None,
    json: Json = False,
) -> int:
    """Plot a log of values: a panel for each unit, gaps where a drive did not answer, and the states of the drives."""
    picture = picture_of(read_rows(log), drives=drive or (), names=name or ())
    save(picture, title or log.name, output)
    faults = f", {counted(len(picture.faults), 'fault')}" if picture.faults else ""
    text = f"{output}: {counted(len(picture.curves), 'curve')}{faults}"
    counts = {"curves": len(picture.curves), "drives": len(picture.drives), "faults": len(picture.faults)}
    tell(text, as_json=json, output=str(output), **counts)
    return 0
