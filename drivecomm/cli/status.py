"""Command `status`: the state of one drive, of a group, or of the whole plant."""

from __future__ import annotations

import sys
import textwrap
from functools import partial
from time import monotonic
from typing import TYPE_CHECKING

import click

from drivecomm.cli import options
from drivecomm.cli.drive_names import known_plant
from drivecomm.cli.line_command import LineCommand
from drivecomm.cli.one_drive import show_status
from drivecomm.cli.output import counted, emit, say, sentence
from drivecomm.errors import DriveError, UsageError, printable
from drivecomm.protocol import parse_options

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from rich.text import Text

    from drivecomm.cli.line_options import LineArguments
    from drivecomm.plant import DriveReport, Plant
    from drivecomm.protocol import MachineValue

_WIDTH = 80
"""Width of the table without a terminal."""

_COLOURS = {
    "fault": "bold red",
    "running": "green",
    "stopping": "yellow",
    "not_ready": "yellow",
    "no answer": "dim",
    "not asked": "dim",
}


@click.command(cls=LineCommand)
@click.argument(
    "drive",
    shell_complete=options.complete_drive_or_group,
    required=False,
    help="PROTOCOL:ADDRESS, a name or a group from the plant file. Default: all drives.",
)
@options.model
def status(*, line: LineArguments, drive: str | None, model: str | None) -> int:
    """Show the state of a drive, of a group, or of all drives of the plant; commands nothing.

    Exit code 5 when a drive has a fault, 4 when one does not answer.
    """
    if drive is None:
        return _of_the_plant(_whole_plant(line), line, model)
    if (group := _group(drive, line)) is not None:
        return _of_the_plant(group, line, model)
    with line.drive(drive, model) as (one, name):
        # Only a drive of a server has standing stops.
        stop = getattr(one, "standing_stop", "")
        if stop and not line.json:
            say(f"{name.name}  {stop}")
        found = one.status()
        show_status(name, found, as_json=line.json, standing_stop=stop)
    return DriveError.exit_code if found.fault else 0


def _group(text: str, line: LineArguments) -> Plant | None:
    """Return the part of the plant that is a group, with the options after its name; None if it is not a group."""
    word, *behind = text.split(",")
    known = None if ":" in word else known_plant(line.plant, port_given=False)
    if known is None or word not in known.groups:
        return None
    return known.only(each.with_options(**parse_options(behind)) for each in known.group(word))


def _whole_plant(line: LineArguments) -> Plant:
    known = known_plant(line.plant, port_given=False)
    if known is None:
        raise UsageError(
            "no drive and no plant; name a drive, such as vabus:1, or a plant file with --plant, or let a scan write "
            "one: drivecomm scan --write plant.toml"
        )
    if not known.drives:
        raise UsageError(f"{known.file}: there is no drive in this plant; add a [[drive]]")
    return known


def _of_the_plant(known: Plant, line: LineArguments, model: str | None) -> int:
    if model is not None:
        raise UsageError(
            "--model is for one drive; name it, or leave --model out: the plant file gives the model of each"
        )
    lines = [each for each in known.lines if known.on_line(each.name)]
    if line.record is not None and len(lines) > 1:
        raise UsageError("--record is for one line, and this plant has several; name a drive, or leave it out")
    if "port" in line.given and all(each.reached_at for each in lines):
        line.refuse(f"{known.file} names the ports of all its lines", "port")
    # Imported late, because only calls with a plant need it.
    from drivecomm.plant import OpenPlant, plant_status

    opening = {key: value for key, value in line.opening.items() if key != "echo" or "echo" in line.given}
    port_of = partial(line.port_of, file=known.file)
    with OpenPlant(known, port_of=port_of, holding=line.stops.over, **opening) as opened:
        reports = plant_status(opened)
    now = monotonic()
    if line.json:
        for report in reports:
            _emit(report, now)
    else:
        _draw(reports, now)
    return max(report.exit_code for report in reports)


def _emit(report: DriveReport, now: float) -> None:
    status, error, drive = report.status, report.error, report.drive
    emit(
        name=drive.name,
        drive=f"{drive.protocol}:{drive.address}",
        drive_name=drive.name,
        model=str(drive.options.get("model", "")),
        line=drive.line,
        title=drive.title,
        armed=drive.armed,
        answers=error is None,
        state=None if status is None else status.state,
        fault=None if status is None else status.fault,
        fault_code=None if status is None else status.fault_code,
        fault_text="" if status is None else status.fault_text,
        output_hz=report.output_hz,
        output_percent=None if status is None else status.actual_percent,
        output_current_a=report.current_a,
        reference=None if report.reference is None else report.reference.value,
        reference_unit="" if report.reference is None else report.reference.unit,
        **_at_machine(report),
        age_s=round(now - report.asked_at, 3),
        error="" if error is None else sentence(error),
        standing_stop=report.standing_stop,
    )


def _at_machine(report: DriveReport) -> dict[str, object]:
    if report.drive.machine is None:
        return {}
    output, reference = report.output_machine, report.reference_machine
    return {
        "output_machine": None if output is None else output.value,
        "reference_machine": None if reference is None else reference.value,
        "machine_unit": report.drive.machine.unit,
    }


_Cell = tuple[str, str]
"""Text of a cell, and its style."""

_HEAD = ("name", "drive", "model", "state", "output", "current", "reference", "age")
_TO_THE_RIGHT = frozenset({"output", "current", "reference", "age"})
# Columns that are dropped first on a narrow terminal.
_DISPENSABLE = ("age", "model", "drive")


def _draw(reports: Sequence[DriveReport], now: float) -> None:
    from rich.console import Console

    console = Console(file=sys.stdout, width=None if sys.stdout.isatty() else _WIDTH, markup=False, highlight=False)
    rows = [
        {name: (printable(text), style) for name, (text, style) in zip(_HEAD, _cells(report, now), strict=True)}
        for report in reports
    ]
    names = list(_HEAD)
    if all(row["name"][0] == row["drive"][0] for row in rows):
        names.remove("drive")
    if not any(row["model"][0] for row in rows):
        names.remove("model")
    width = {name: max(len(name), *(len(row[name][0]) for row in rows)) for name in names}
    for name in _DISPENSABLE:
        if name in names and sum(width[each] for each in names) + 2 * (len(names) - 1) > console.width:
            names.remove(name)
    wanted = names

    def line_of(row: dict[str, _Cell]) -> Text:
        from rich.text import Text

        text = Text()
        for place, name in enumerate(wanted):
            words, style = row[name]
            padded = words.rjust(width[name]) if name in _TO_THE_RIGHT else words.ljust(width[name])
            text.append("  " if place else "").append(padded, style)
        text.rstrip()
        return text

    console.print(line_of({name: (name, "bold") for name in wanted}), soft_wrap=True)
    for report, row in zip(reports, rows, strict=True):
        console.print(line_of(row), soft_wrap=True)
        _explain(report, console.width, lambda text, style: console.print(text, style=style, soft_wrap=True))
    faults = sum(report.status is not None and report.status.fault for report in reports)
    unasked = sum(map(_cannot_be_asked, reports))
    silent = sum(report.status is None for report in reports) - unasked
    counts = ((faults, "with a fault"), (silent, "not answering"), (unasked, "that cannot be polled"))
    wrong = [f"{number} {what}" for number, what in counts if number]
    text = f"{counted(len(reports), 'drive')}: {', '.join(wrong) or 'no fault'}"
    console.print(text, soft_wrap=True)


def _cannot_be_asked(report: DriveReport) -> bool:
    """Return whether a wrong configuration prevented every request to a drive, so that its wiring is not suspected."""
    return report.status is None and isinstance(report.error, UsageError)


def _cells(report: DriveReport, now: float) -> tuple[_Cell, ...]:
    drive, found = report.drive, report.status
    silent = "not asked" if _cannot_be_asked(report) else "no answer"
    state = silent if found is None else found.state.value
    colour = _COLOURS.get(state, "")
    dim = "dim" if found is None else ""
    output = f"{report.output_hz:.2f} Hz{_beside(report.output_machine)}" if report.output_hz is not None else ""
    if not output and found is not None and found.actual_percent is not None:
        output = f"{found.actual_percent:.2f} %"
    reading = report.reference
    reference = (
        "-" if reading is None or isinstance(reading.value, str) else f"{reading.value:.2f} {reading.unit}".rstrip()
    ) + _beside(report.reference_machine)
    return (
        (drive.name, dim or "bold"),
        (f"{drive.protocol}:{drive.address}", dim),
        (str(drive.options.get("model", "")), dim),
        (state.replace("_", " "), colour),
        (output or "-", dim),
        ("-" if report.current_a is None else f"{report.current_a:.2f} A", dim),
        (reference, dim),
        ("-" if found is None else f"{max(0.0, now - report.asked_at):.1f} s", dim),
    )


def _beside(machine: MachineValue | None) -> str:
    return "" if machine is None else f" = {machine}"


def _explain(report: DriveReport, width: int, tell: Callable[[str, str], None]) -> None:
    """Print the error or fault of a drive, and its standing stop, below its row."""
    if report.standing_stop:
        _wrapped(report.standing_stop, "yellow", width, tell)
    if report.error is not None:
        words, style = sentence(report.error), "dim"
    elif report.status is not None and report.status.fault:
        code = "" if report.status.fault_code is None else f" {report.status.fault_code}"
        words, style = printable(f"fault{code} {report.status.fault_text}".rstrip()), "red"
    elif report.status is not None and report.status.warning:
        words, style = "a warning is active", "yellow"
    else:
        return
    _wrapped(words, style, width, tell)


def _wrapped(words: str, style: str, width: int, tell: Callable[[str, str], None]) -> None:
    for text in textwrap.wrap(words, max(20, width - 4), break_long_words=False, break_on_hyphens=False):
        tell(f"    {text}", style)
