"""Command `plot`: a value log, or a server's history, as a picture or a page."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from drivecomm.cli import options
from drivecomm.cli.commands import CliCommand
from drivecomm.cli.output import counted, tell
from drivecomm.cli.output_files import force_option, must_be_free
from drivecomm.cli.time_ranges import from_option, last_option, time_range, to_option
from drivecomm.cli.values import FILE
from drivecomm.errors import UsageError
from drivecomm.plant.value_log import read_rows
from drivecomm.plant.value_plots import picture_of, save

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from drivecomm.cli.time_ranges import TimeRange
    from drivecomm.plant.value_log import LogRow

HISTORY_ENDING = ".sqlite"


@click.command(cls=CliCommand)
@click.option("--output", "-o", type=FILE, required=True, help="The file to write: .png, .svg or .html.")
@click.argument(
    "log",
    type=FILE,
    required=False,
    help="A file written by --log: .csv or .parquet; or a history: .sqlite. Default: the history of the plant.",
)
@click.option("--plant", type=FILE, help="Plant file of a history. Default: plant.toml in this folder.")
@click.option("--drive", metavar="DRIVE", multiple=True, help="Only this drive; repeatable.")
@click.option("--name", metavar="NAME", multiple=True, help="Only this quantity; repeatable.")
@force_option
@click.option("--title", metavar="TEXT", help="Title. Default: the name of the log.")
@from_option
@to_option
@last_option
@options.json
def plot(
    *,
    output: Path,
    log: Path | None,
    plant: Path | None,
    drive: tuple[str, ...],
    name: tuple[str, ...],
    force: bool,
    title: str | None,
    begin: str | None,
    end: str | None,
    last: str | None,
    json: bool,
) -> int:
    """Plot a log or a history: a panel for each unit, gaps where a drive did not answer, and the drives' states.

    Times are local, and the plot names their zone.
    """
    if log is not None and plant is not None:
        raise UsageError(f"--plant names a plant whose history is plotted; leave {log} out, or --plant")
    must_be_free(output, "--output", force=force)
    if log is None:
        from drivecomm.cli.history import history_file

        log = history_file(plant)
    rows = _rows(log, drive, time_range(begin, end, last))
    picture = picture_of(rows, drives=drive, names=name)
    save(picture, title or log.name, output)
    faults = f", {counted(len(picture.faults), 'fault')}" if picture.faults else ""
    text = f"{output}: {counted(len(picture.curves), 'curve')}{faults}"
    counts = {"curves": len(picture.curves), "drives": len(picture.drives), "faults": len(picture.faults)}
    tell(text, as_json=json, output=str(output), **counts)
    return 0


def _rows(log: Path, drives: Sequence[str], when: TimeRange) -> Iterator[LogRow]:
    if log.suffix != HISTORY_ENDING:
        yield from (row for row in read_rows(log) if when.has(row.time.timestamp()))
        return
    # Imported late, because log files do not need it.
    from drivecomm.server.history import History, log_row

    with History(log) as history:
        for drive in (*drives,) or (None,):
            yield from map(log_row, history.values(drive, None, *when))
