"""Command `forecast`: duration of a poll plan, and whether it fits its lines."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from drivecomm.cli.drive_names import PLANT_FILE, plant_file
from drivecomm.cli.line_command import LineCommand
from drivecomm.cli.output import counted, emit, plain, print_table, say
from drivecomm.cli.poll import given_plan, period_option, plan_option, words_argument
from drivecomm.cli.values import NUMBER
from drivecomm.errors import UsageError
from drivecomm.tomlfile import read_toml
from drivecomm.virtual import forecast as foresee

if TYPE_CHECKING:
    from pathlib import Path

    from drivecomm.cli.line_options import LineArguments
    from drivecomm.line import PollPlan
    from drivecomm.virtual import Forecast

_COLUMNS = ("period\ns", "every\ns", "late\nms", "takes\nms", "wire\nms", "delay\nms", "pause\nms", "rest\nms")
_WIDTH = 200
"""Limit of the width of the table without a terminal."""


@click.command(cls=LineCommand)
@words_argument
@plan_option
@period_option
@click.option("--delay", type=NUMBER, metavar="MS", help="Reply delay of the drives in milliseconds.")
@click.option("--guard", type=NUMBER, metavar="MS", default=5.0, help="Quiet time after a change of line settings.")
@click.option(
    "--room", metavar="PERCENT", default="5%", help="Share of the line's time reserved for commands and repetitions."
)
@click.option("--served", is_flag=True, help="Also count the status of each drive, which a server polls.")
def forecast(
    *,
    line: LineArguments,
    words: tuple[str, ...],
    plan: Path | None,
    period: float | None,
    delay: float | None,
    guard: float,
    room: str,
    served: bool,
) -> int:
    """Estimate how long a round of a poll plan takes, and whether the plan fits its lines.

    Takes the same plan as poll and opens no port. For a plant file with a [server] or a [[door]], it counts all
    requests of its server. Exit code 1 if the plan does not fit or has no room to spare, or if something in it cannot
    be read.
    """
    if served and (words or period is not None):
        raise UsageError("a server polls what the plant file lists; give --served without drives and parameters")
    file = _served_file(plan, line, always=served) if not words and period is None else None
    if file is not None:
        chosen, status_period_s = _served_plan(file, line)
        if not line.json:
            say(f"{file} as a server polls it: its polls, and the status of each drive every {status_period_s:g} s")
    else:
        chosen, line = given_plan(words, plan, line, period_s=period)
    delay_s = None if delay is None else delay / 1000
    share, well = _share(room), True
    for port in chosen.lines:
        found = foresee(chosen.on_line(port), guard_s=guard / 1000, reply_delay_s=delay_s, room=share, **line.facts)
        well = well and found.room_to_spare and not any(item.cause for item in found.items)
        if line.json:
            told = plain(found)
            for each in (*told["items"], *told["drives"]):
                each["drive_name"] = each["drive"]
            emit(**told)
        else:
            _draw(found, share)
    return 0 if well else 1


def _served_file(file: Path | None, line: LineArguments, *, always: bool) -> Path | None:
    """Return the plant file that a server serves, None for a plan that is only polled. always: skip this test."""
    if always:
        line.refuse("the plant file names the ports of its drives", "port")
        return plant_file(file or line.plant, port_given=False) or PLANT_FILE
    path = file or plant_file(line.plant, port_given="port" in line.given)
    if path is None or "port" in line.given:
        return None
    content = read_toml(path, "a plant").content
    return path if "server" in content or "door" in content else None


def _served_plan(path: Path, line: LineArguments) -> tuple[PollPlan, float]:
    """Return the permanent poll plan of a plant's server, and its status period in seconds."""
    from drivecomm.plant import read_plant, with_usual_polls
    from drivecomm.server import read_settings

    period_s = read_settings(path).status_period_s
    plan = with_usual_polls(read_plant(path)).served_plan(period_s)
    return plan.with_drives(lambda one: one.with_options(**line.said_facts)), period_s


def _share(percent: str) -> float:
    try:
        return float(percent.strip().removesuffix("%")) / 100
    except ValueError:
        raise UsageError(f"invalid --room {percent!r}; give a percentage of the line's time, such as 5%") from None


def _draw(found: Forecast, room: float) -> None:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    table = Table(title=found.port or None, title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
    table.add_column("drive", overflow="fold")
    table.add_column("parameter", overflow="fold")
    for name in _COLUMNS:
        table.add_column(name, justify="right", no_wrap=True)
    before = ""
    for item in found.items:
        times = (item.late_s, item.seconds, item.wire_s, item.delay_s, item.pause_s, item.rest_s)
        table.add_row(
            item.drive if item.drive != before else "",
            item.parameter,
            f"{item.period_s:g}",
            f"{item.every_s:.3g}",
            *(f"{1000 * seconds:.1f}" for seconds in times),
        )
        before = item.drive
    print_table(table, _WIDTH)
    for drive in found.drives:
        part = f"{drive.utilisation:.1%} of the line's time"
        say(f"{drive.drive}  {drive.settings}  {1000 * drive.seconds:.1f} ms a round  {part}")
    need = f"the plan needs {found.utilisation:.1%} of the line's time"
    verdict = "it fits" if found.fits else "it does not fit"
    if found.fits and not found.room_to_spare:
        verdict += f" without the spare {100 * room:g}% for commands and repetitions"
    if unread := sum(bool(item.cause) for item in found.items):
        verdict += f", without {counted(unread, 'parameter')} that cannot be read"
    say(f"a round takes {1000 * found.cycle_s:.1f} ms; {need}; {verdict}")
    for sentence in found.advice:
        say(f"  {sentence}")
