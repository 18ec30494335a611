"""Command `history`: a server's record of values, events, commands, and the fault logs of drives."""

from __future__ import annotations

import os
from contextlib import contextmanager
from heapq import merge
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from drivecomm.cli import options
from drivecomm.cli.commands import CliCommand
from drivecomm.cli.drive_names import plant_file
from drivecomm.cli.output import counted, emit, plain, say, tell
from drivecomm.cli.output_files import force_option, must_be_free
from drivecomm.cli.time_ranges import clock, from_option, last_option, time_range, to_option
from drivecomm.cli.values import FILE
from drivecomm.errors import FileFormatError, UsageError
from drivecomm.server import command_words
from drivecomm.server.history import History, log_row

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from drivecomm.cli.time_ranges import TimeRange
    from drivecomm.plant.value_log import CsvLog, ParquetLog
    from drivecomm.server.history import PastValue

_SHOWN = "1h"
"""Default time range of the display; exports have no limit."""


@click.command(cls=CliCommand)
@click.argument("drive", required=False, help="Its name in the plant. Default: the latest values of all.")
@click.argument(
    "quantities", metavar="[QUANTITY...]", nargs=-1, help="Only these quantities, such as output_frequency."
)
@click.option("--events", is_flag=True, help="Show what happened: faults, silence, commands.")
@click.option("--commands", is_flag=True, help="Show commands, their senders and their results.")
@click.option("--fault-logs", is_flag=True, help="Show the fault logs that were read from the drives.")
@from_option
@to_option
@last_option
@click.option("--csv", type=FILE, help="Export the values as CSV.")
@click.option("--parquet", type=FILE, help="Export the values as Parquet.")
@click.option("--file", type=FILE, help="The history file. Default: that of the plant.")
@click.option("--plant", type=FILE, help="Plant file. Default: plant.toml in this folder.")
@force_option
@options.json
def history(
    *,
    drive: str | None,
    quantities: tuple[str, ...],
    events: bool,
    commands: bool,
    fault_logs: bool,
    begin: str | None,
    end: str | None,
    last: str | None,
    csv: Path | None,
    parquet: Path | None,
    file: Path | None,
    plant: Path | None,
    force: bool,
    json: bool,
) -> int:
    """Show the record of a server: values, events, commands, and the drives' own fault logs.

    The history can be read while the server writes it, and without a server. Times are local, and end with the zone.
    Without a time, the last hour is shown; --csv and --parquet export everything then.
    """
    if file is not None and plant is not None:
        raise UsageError("--file names the history itself, so --plant has no effect; leave it out")
    chosen = [flag for flag, given in _flags(events, commands, fault_logs, csv, parquet).items() if given]
    if len(chosen) > 1:
        raise UsageError(f"{' and '.join(chosen)} exclude each other; give one of them")
    lists = events or commands or fault_logs
    if lists and quantities:
        raise UsageError(f"{chosen[0]} lists drives, not quantities; leave {quantities[0]} out")
    target = csv or parquet
    must_be_free(target, "--csv or --parquet", force=force)
    when = time_range(begin, end, last, otherwise=None if target else _SHOWN)
    with History(file or history_file(plant)) as opened:
        if events:
            _show_events(opened, drive, when, as_json=json)
        elif commands:
            _show_commands(opened, drive, when, as_json=json)
        elif fault_logs:
            _show_fault_logs(opened, drive, when, as_json=json)
        elif target is not None:
            count = _export(_wanted(opened, drive, quantities, when), target, is_csv=csv is not None)
            tell(f"{target}: {counted(count, 'value')}", as_json=json, output=str(target), values=count)
        else:
            given = drive is not None or any(each is not None for each in (begin, end, last))
            found = opened.latest() if not given else _wanted(opened, drive, quantities, when)
            width = max(map(len, opened.drives()), default=0)
            for value in found if given else sorted(found, key=lambda one: (one.drive, one.name)):
                _show(value, width, as_json=json)
    return 0


def history_file(plant: Path | None) -> Path:
    """Return the history file of a plant: of its running server, otherwise of its plant file. Raises UsageError."""
    path = plant_file(plant, port_given=False)
    if path is None:
        raise UsageError("there is no plant file here; give --plant plant.toml, or the history itself with --file")
    # Imported late, because --file makes it unnecessary.
    from drivecomm.client import server_of_plant
    from drivecomm.server import read_settings

    server = server_of_plant(path)
    if server is not None and server.history:
        return Path(server.history)
    settings = read_settings(path)
    if settings.history is None:
        raise UsageError(f"{path}: history = false switches the history off; remove it, and restart the server")
    return settings.history.file


def _flags(events: bool, commands: bool, fault_logs: bool, csv: Path | None, parquet: Path | None) -> dict[str, Any]:
    return {
        "--events": events, "--commands": commands, "--fault-logs": fault_logs, "--csv": csv, "--parquet": parquet,
    }  # fmt: skip


def _wanted(history: History, drive: str | None, quantities: tuple[str, ...], when: TimeRange) -> Iterator[PastValue]:
    """Return the values in the order in which they were recorded."""
    names = quantities or (None,)
    return merge(*(history.values(drive, name, *when) for name in names), key=lambda value: value.row)


def _show(value: PastValue, width: int, *, as_json: bool) -> None:
    """Print a value. width: length of the longest drive name."""
    if as_json:
        emit(**plain(value), drive_name=value.drive)
        return
    shown = "-" if value.value is None else f"{value.value} {value.unit}".rstrip()
    shown += f" ({value.text})" if value.text else ""
    why = f": {value.note}" if value.note else ""
    say(f"{clock(value.time_s)}  {value.drive:<{width}}  {value.name:<24} {shown:>14}  {value.quality}{why}")


def _show_events(history: History, drive: str | None, when: TimeRange, *, as_json: bool) -> None:
    for each in history.events(drive, None, *when):
        event = each.event
        if as_json:
            emit(row=each.row, **plain(event), drive_name=event.drive)
        else:
            about = " ".join(filter(None, (event.drive, event.line and f"(line {event.line})")))
            who = f", by {event.who}" if event.who else ""
            say(f"{clock(event.time_s)}  {event.kind:<10}  {about or '-'}: {event.text}{who}")


def _show_commands(history: History, drive: str | None, when: TimeRange, *, as_json: bool) -> None:
    for each in history.commands(drive, *when):
        if as_json:
            emit(**plain(each), drive_name=each.drive)
        else:
            asked = command_words(each.verb, each.arguments)
            why = f": {each.text}" if each.text else ""
            say(f"{clock(each.time_s)}  {each.drive}  {asked}, by {each.who} ({each.door}): {each.outcome}{why}")


def _show_fault_logs(history: History, drive: str | None, when: TimeRange, *, as_json: bool) -> None:
    for each in history.fault_logs(drive, *when):
        if as_json:
            emit(**plain(each), drive_name=each.drive)
        else:
            text = f" ({each.text})" if each.text else ""
            say(f"{clock(each.time_s)}  {each.drive}  {each.place:>2}  {each.address:<10} {each.value}{text}")


def _export(values: Iterable[PastValue], path: Path, *, is_csv: bool) -> int:
    """Write values to a file in the form of a value log, and return their number."""
    # An existing log would be appended to instead of replaced.
    path.unlink(missing_ok=True)
    count = 0
    # Only users who may read the history may read its export, since it shows commands and motor activity.
    before = os.umask(0o077)
    try:
        with _opened(path, is_csv=is_csv) as log:
            for count, value in enumerate(values, 1):  # noqa: B007 - used after the loop
                log.write(log_row(value))
    finally:
        os.umask(before)
    return count


@contextmanager
def _opened(path: Path, *, is_csv: bool) -> Iterator[CsvLog | ParquetLog]:
    from drivecomm.plant.value_log import CsvLog, ParquetLog

    log = CsvLog(path) if is_csv else ParquetLog(path)
    try:
        yield log
        log.close()
    except OSError as error:
        log.abandon()
        raise FileFormatError(f"{path}: cannot be written: {error.strerror or error}; it is incomplete") from error
    except BaseException:
        log.abandon()
        raise
