"""Command `watch`: its lines, its log, and its screen, which is imported late."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from drivecomm.cli.drive_names import plant_file
from drivecomm.cli.line_command import LineCommand
from drivecomm.cli.value_files import log_option
from drivecomm.cli.values import NUMBER
from drivecomm.cli.watch.log_switch import LogSwitch
from drivecomm.errors import DriveCommError, UsageError
from drivecomm.plant import read_plant
from drivecomm.plant.watching import WatchedLine, Watcher, lines_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivecomm.cli.line_options import LineArguments
    from drivecomm.protocol import DriveConfig


@click.command(cls=LineCommand)
@click.argument(
    "what",
    metavar="[PLANT.toml | DRIVE...]",
    nargs=-1,
    help="A plant file (default: plant.toml here), its drives or groups, or drives on --port: vabus:1,model=agile.",
)
@click.option("--period", type=NUMBER, metavar="SECONDS", default=1.0, help="Time between polls of a drive.")
@click.option("--name", metavar="NAME", multiple=True, help="Common name to read; repeatable. Default: the usual ones.")
@click.option(
    "--for", "duration", type=NUMBER, metavar="SECONDS", help="Stop polling after this time; the screen stays."
)
@log_option
@click.option("--arm", is_flag=True, help="Allow start and reset of drives that are armed in the plant file.")
def watch(
    *,
    line: LineArguments,
    what: tuple[str, ...],
    period: float,
    name: tuple[str, ...],
    duration: float | None,
    log: Path | None,
    arm: bool,
) -> int:
    """Watch drives on a live screen in the terminal: states, values, trends, faults, counters.

    It commands nothing by itself; its keys can always stop a motor, and with --arm start or reset one. Exit code 3 when
    no line can be opened, 1 when values are missing in the log because the disk was full. It is not a safety function.
    """
    if line.json or line.trace or line.record is not None:
        raise UsageError("watch is for a terminal; use drivecomm poll for --json, --trace and --record")
    if duration is not None and not duration > 0:
        raise UsageError(f"--for {duration:g} s is not a valid time; give seconds above 0")
    lines = watched_lines(what, line)
    _must_be_a_terminal()
    file = what[0] if what else plant_file(line.plant, port_given=False)
    title = line.named_port if line.port is not None or file is None else Path(file).name
    switch = LogSwitch(log)
    chosen: dict[str, Any] = {"names": name} if name else {}
    watcher = Watcher(lines, period_s=period, holding=line.stops.over_async, **chosen)
    if name and watcher.unmapped_names:
        missing = ", ".join(watcher.unmapped_names)
        raise UsageError(f"no drive here has {missing}: no model says which parameter it is")
    watcher.told = switch.tell
    screen = _screen()(watcher, title=title, log=switch, armed=arm, duration_s=duration)
    if log is not None:
        switch.switch()
    try:
        ended_by = screen.run()
    finally:
        complaint = switch.close()
    if ended_by is not None:
        raise ended_by
    if complaint:
        raise DriveCommError(complaint)
    # The code is 1 after an exception that textual has printed.
    return int(screen.return_code or 0)


def _must_be_a_terminal() -> None:
    # Keys come from standard input, and the screen is drawn on standard error.
    streams = {"input": sys.stdin, "output": sys.stdout, "error": sys.stderr}
    elsewhere = [name for name, stream in streams.items() if stream is None or not stream.isatty()]
    if "output" in elsewhere:
        raise UsageError("watch needs a terminal; without one, use drivecomm poll")
    if elsewhere:
        names = " and ".join(f"standard {name}" for name in elsewhere)
        raise UsageError(f"watch needs the terminal for {names}, too; do not redirect it, or use drivecomm poll")


def watched_lines(what: Sequence[str], line: LineArguments) -> list[WatchedLine]:
    """Return the lines that the words of a call name. Raises UsageError."""
    plants = [word for word in what if word.endswith(".toml") and ":" not in word.partition(",")[0]]
    if plants and len(what) > 1:
        raise UsageError("give one plant file or drives, not both")
    if plants:
        line.refuse(f"the plant is {plants[0]}", "plant")
    elif not what and (usual := plant_file(line.plant, port_given="port" in line.given)):
        plants = [str(usual)]
    if plants:
        line.refuse(f"the ports are those of {plants[0]}", "port")
        return lines_of(read_plant(Path(plants[0])), _options(line))
    if not what:
        raise UsageError("nothing to watch; name a plant file, or drives such as vabus:1,model=agile with --port")
    lines: dict[LineArguments, list[DriveConfig]] = {}
    for reached, drive in line.reaching_each(what):
        lines.setdefault(reached, []).append(drive)
    return [
        WatchedLine(name=drives[0].line, port=reached.named_port, drives=tuple(drives), options=_options(reached))
        for reached, drives in lines.items()
    ]


def _options(line: LineArguments) -> dict[str, Any]:
    given = {**line.facts, "low_latency": line.low_latency}
    if "echo" in line.given or line.echo != "off":
        given["echo"] = line.echo
    if line.rs485:
        given["rs485"] = True
    return {name: value for name, value in given.items() if value is not None}


def _screen() -> Any:
    try:
        from drivecomm.cli.watch.screen import WatchScreen
    except ModuleNotFoundError as error:
        if error.name is None or not error.name.startswith("textual"):
            raise
        raise UsageError("watch needs textual, which is not installed; install drivecomm[watch]") from None
    return WatchScreen
