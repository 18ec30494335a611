"""The watch command: what is to be watched, its log, and the screen, which is loaded only when it is wanted."""

from __future__ import annotations

import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from drivecomm.cli.drive_names import plant_file
from drivecomm.cli.line_options import LineOptions
from drivecomm.cli.value_files import Log
from drivecomm.errors import DriveCommError, UsageError
from drivecomm.plant import read_plant
from drivecomm.plant.value_log import open_log
from drivecomm.plant.watching import WatchedLine, Watcher, lines_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.plant.value_log import ValueLog
    from drivecomm.polling import PollResult


def watch(
    line: LineOptions,
    what: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[PLANT.toml | DRIVE...]",
            help="A plant file (default: plant.toml here), or drives on --port such as vabus:1,model=agile.",
        ),
    ] = None,
    period: Annotated[float, typer.Option("--period", metavar="SECONDS", help="Time between polls of a drive.")] = 1.0,
    name: Annotated[
        list[str] | None, typer.Option("--name", help="Common name to read; repeatable. Default: the usual ones.")
    ] = None,
    duration: Annotated[
        float | None, typer.Option("--for", metavar="SECONDS", help="Stop polling after this time; the screen stays.")
    ] = None,
    log: Log = None,
    arm: Annotated[
        bool, typer.Option("--arm", help="Allow start and reset of drives that are armed in the plant file.")
    ] = False,
) -> int:
    """Watch drives on a live screen in the terminal: states, values, trends, faults, counters.

    It commands nothing by itself; its keys can always stop a motor, and with --arm start or reset one. Exit code 3 when
    no line can be opened, 1 when values are missing in the log because the disk was full. It is not a safety function.
    """
    if line.json or line.trace or line.record is not None:
        raise UsageError("watch is for a terminal; use drivecomm poll for --json, --trace and --record")
    if duration is not None and not duration > 0:
        raise UsageError(f"--for {duration:g} s is not possible; give seconds above 0")
    lines = watched_lines(what or [], line)
    _must_be_a_terminal()
    file = what[0] if what else plant_file(line.plant, port_given=False)
    title = line.named_port if line.port is not None or file is None else Path(file).name
    switch = LogSwitch(log)
    chosen: dict[str, Any] = {"names": name} if name else {}
    watcher = Watcher(lines, period_s=period, **chosen)
    if name and watcher.nobody_has:
        missing = ", ".join(watcher.nobody_has)
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
    return 0


def _must_be_a_terminal() -> None:
    # Keys come by the first, and the screen goes out by the last.
    streams = {"input": sys.stdin, "output": sys.stdout, "error": sys.stderr}
    elsewhere = [name for name, stream in streams.items() if stream is None or not stream.isatty()]
    if "output" in elsewhere:
        raise UsageError("watch needs a terminal; use drivecomm poll where there is none")
    if elsewhere:
        names = " and ".join(f"standard {name}" for name in elsewhere)
        raise UsageError(f"watch needs the terminal for {names}, too; do not send it elsewhere, or use drivecomm poll")


def watched_lines(what: list[str], line: LineOptions) -> list[WatchedLine]:
    """Return the lines that the words of a call name. Raises UsageError."""
    options = _options(line)
    if what:
        line.refuse("the drives are named here", "plant")
    elif usual := plant_file(line.plant, port_given=line.port is not None):
        what = [str(usual)]
    plants = [word for word in what if word.endswith(".toml") and ":" not in word.partition(",")[0]]
    if plants and len(what) > 1:
        raise UsageError("give one plant file or drives, not both")
    if plants:
        if line.port is not None:
            raise UsageError(f"the ports are those of {plants[0]}; leave --port and DRIVECOMM_PORT out")
        return lines_of(read_plant(Path(plants[0])), options)
    if not what:
        raise UsageError("nothing to watch; name a plant file, or drives such as vabus:1,model=agile with --port")
    drives = tuple(line.reaching(word)[1] for word in what)
    return [WatchedLine(name=line.named_port, port=line.named_port, drives=drives, options=options)]


def _options(line: LineOptions) -> dict[str, Any]:
    given = {**line.facts, "low_latency": line.low_latency}
    if "echo" in line.given or line.echo != "off":
        given["echo"] = line.echo
    if line.rs485:
        given["rs485"] = True
    return {name: value for name, value in given.items() if value is not None}


def _screen() -> Any:
    try:
        from drivecomm.cli.watch.screen import WatchScreen  # noqa: PLC0415 - optional, and slow to load
    except ModuleNotFoundError as error:
        if error.name is None or not error.name.startswith("textual"):
            raise
        raise UsageError("watch needs textual, which is not installed; install drivecomm[watch]") from None
    return WatchScreen


class LogSwitch:
    """Keeps a log or does not. path: the file; None for one in this folder that is named after the time."""

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self._log: ValueLog | None = None
        self.is_on = False
        self.said: Callable[[str], None] = lambda _: None
        """Hears when values cannot be logged for want of room, and when they are again; set before it is switched."""

    def switch(self) -> str:
        """Switch it on or off; return what to say. Raises DriveCommError for a file that cannot be."""
        if self.is_on:
            self.is_on = False
            return f"logging is paused; {self._name} is finished when watch ends"
        if self._log is None:
            path = self._path or Path(f"watch-{datetime.now(UTC):%Y%m%d-%H%M%S}.csv")
            self._log = open_log(path, tell=self.said)
        self.is_on = True
        return f"logging to {self._name}"

    def tell(self, result: PollResult) -> None:
        """Write a result if the log is on."""
        if self.is_on and self._log is not None:
            self._log.write(result)

    @property
    def words(self) -> str:
        """How it is, for the head of the screen."""
        if self.is_on:
            missing = f", {self._log.missing} missing" if self._log is not None and self._log.missing else ""
            return f"log {self._name}{missing}"
        return "log paused" if self._log is not None else "log off"

    def close(self) -> str:
        """Finish the file; return what is missing in it, or why it cannot be finished, empty when all is well."""
        if self._log is None:
            return ""
        log, self._log, self.is_on = self._log, None, False
        try:
            log.close()
        except (DriveCommError, OSError) as error:
            return str(error)
        return log.summary

    @property
    def _name(self) -> str:
        return self._log.path.name if self._log is not None else ""
