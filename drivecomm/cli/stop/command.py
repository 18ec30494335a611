"""Command `stop` for click: accepts all options, and reports mistakes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from drivecomm.cli import options
from drivecomm.cli.line_command import LineCommand
from drivecomm.cli.stop.quick import stop_motors

if TYPE_CHECKING:
    from drivecomm.cli.line_options import LineArguments


@click.command(cls=LineCommand)
@click.argument(
    "drives",
    shell_complete=options.complete_drive_or_group,
    metavar="[DRIVE...]",
    nargs=-1,
    help="PROTOCOL:ADDRESS, names or groups from the plant file, or one PROTOCOL:* for all.",
)
@click.option("--all", "everything", is_flag=True, help="Stop everything that is on the line or in the plant.")
@click.option("--how", metavar="KIND", default="ramp", help="ramp, coast, quick or dc_brake.")
@options.model
def stop(*, line: LineArguments, drives: tuple[str, ...], everything: bool, how: str, model: str | None) -> int:
    """Stop one motor or several, or with --all every motor.

    A group of the plant file stands for its drives. --all works on all lines at the same time: it broadcasts a stop for
    each protocol and then stops each drive of the plant individually, so that it confirms. PROTOCOL:* does that with
    the drives of one protocol; without a plant file, or with --port, it only broadcasts, on one line, which no drive
    confirms. Exit code 5 unless every drive has confirmed; with --all and without a plant file no drive can. Drives
    that are not armed in the plant file are stopped too.
    """
    return stop_motors(line, drives, everything=everything, how=how, model=model)
