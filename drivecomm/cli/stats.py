"""Command `stats`: drives are polled for a while, and their replies and errors counted."""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click

from drivecomm.cli import options
from drivecomm.cli.drive_names import known_plant
from drivecomm.cli.line_command import LineCommand
from drivecomm.cli.output import emit, note, print_table, say, times_ms
from drivecomm.cli.values import NUMBER
from drivecomm.errors import DriveError, NotAnsweringError, ReplyError, UsageError
from drivecomm.link import COUNTERS, REPLY_TIME_BOUNDS_MS, Statistics, total
from drivecomm.protocol import DriveConfig

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from drivecomm.bus import BlockingLine, Drive
    from drivecomm.cli.line_options import LineArguments
    from drivecomm.link import ReplyTimes

_ALWAYS_SHOWN = ("requests", "replies", "retries", "timeouts", "damaged")
_PERCENTILES = (50, 95, 99)
_BAR_WIDTH = 40
# Output that is not a terminal is not wrapped at a terminal's width.
_WIDTH = 250
# Pause in seconds while every drive is given up.
_IDLE_S = 0.02


@click.command(cls=LineCommand)
@click.argument(
    "drives",
    shell_complete=options.complete_drive_or_group,
    metavar="[DRIVE...]",
    nargs=-1,
    help="PROTOCOL:ADDRESS, a name or a group from the plant file. Default: all there, or those a scan finds.",
)
@click.option("--for", "seconds", type=NUMBER, metavar="SECONDS", default=5.0, help="Polling time.")
def stats(*, line: LineArguments, drives: tuple[str, ...], seconds: float) -> int:
    """Poll drives for a while and count replies, errors and reply times.

    They are asked in turn, by probes that cannot move a motor; lines are polled one after the other. Exit code 1 when a
    drive never answered, or none was found.
    """
    if not 0 < seconds < float("inf"):
        raise UsageError(f"{seconds:g} s is not a valid time; give --for a number above 0")
    if not drives and (known := known_plant(line.plant, port_given="port" in line.given)):
        drives = tuple(drive.name for drive in known.drives)
    lines: dict[LineArguments, dict[str, DriveConfig]] = {}
    for reached, name in line.reaching_each(drives):
        lines.setdefault(reached, {})[name.name] = name
    lines = lines or {line: {str(name): name for name in _scanned(line)}}
    if line.record is not None and len(lines) > 1:
        raise UsageError("--record is for one line, and these drives are on several; leave it out")
    answered = [_measure(at, names, seconds, headed=len(lines) > 1) for at, names in lines.items() if names]
    return 0 if answered and all(answered) else 1


def _measure(line: LineArguments, names: Mapping[str, DriveConfig], seconds: float, *, headed: bool) -> bool:
    """Poll the drives of one line, and print the statistics; return whether all of them have answered."""
    if headed and not line.json:
        say(line.named_port)
    with line.bus() as bus:
        asked = {called: one.build(bus.drive) for called, one in names.items()}
        _count_from_now(bus)
        began = bus.now()
        try:
            _ask_all(bus, list(asked.values()), began + seconds)
        finally:
            # Statistics are also printed after Ctrl-C or the loss of the port.
            counted = {called: bus.statistics.get(one.name, Statistics()) for called, one in asked.items()}
            _show(counted, names, bus.now() - began, line)
    return all(each.counters["replies"] for each in counted.values())


def _count_from_now(bus: BlockingLine) -> None:
    """Reset the counters of a line on which a server may have counted for days."""
    from drivecomm.client import ServedBus

    if isinstance(bus, ServedBus):
        bus.count_from_now()


def _scanned(line: LineArguments) -> list[DriveConfig]:
    """Return the drives on the line, found over a separate bus, so that the scan is neither counted nor recorded."""
    note("no drive named, so the line is scanned first")
    with replace(line, record=None).bus() as bus:
        found = [one for one in bus.scan() if one.sound]
    if not found:
        note("no drive found; name one, or check the line with drivecomm doctor")
    return [DriveConfig(protocol=one.protocol, address=one.address) for one in found]


def _ask_all(bus: BlockingLine, drives: Sequence[Drive], until: float) -> None:
    asking = [_question(bus, drive) for drive in drives if drive.peer.probe is not None]
    while bus.now() < until:
        idle = True
        for ask in asking:
            began = bus.now()
            if began >= until:
                return
            try:
                ask()
            except (NotAnsweringError, ReplyError, DriveError):
                idle = idle and bus.now() - began < _IDLE_S
            else:
                idle = False
        if idle:
            bus.sleep_until(min(until, bus.now() + _IDLE_S))


def _question(bus: BlockingLine, drive: Drive) -> Callable[[], object]:
    """Return a function that probes a drive."""
    from drivecomm.bus import Bus
    from drivecomm.line import Job

    probe = drive.peer.probe
    if probe is None or not isinstance(bus, Bus):
        return drive.probe
    # Drive.probe would keep probing a silent drive; here it is given up, as in any program.
    return lambda: bus.run(Job(drive.peer, probe()))


def _show(
    counted: Mapping[str, Statistics], names: Mapping[str, DriveConfig], seconds: float, line: LineArguments
) -> None:
    everything = total(counted.values())
    if line.json:
        for name, each in counted.items():
            emit(drive=str(names[name]), name=name, drive_name=name, line=line.port, **_plain(each, seconds))
        emit(bus=line.port, **_plain(everything, seconds))
        return
    rows = [*counted.items(), *([("all", everything)] if len(counted) > 1 else [])]
    _draw_counters(rows, seconds)
    _draw_times(rows)
    for name, each in counted.items():
        if 2 * each.counters["noise bytes"] >= each.counters["replies"] > 0:
            say(f"{name}: noise bytes with most replies; drivecomm doctor finds the cause and a remedy")
    for name, each in rows:
        if each.reply_times.count:
            say()
            say(f"reply times of {name}")
            _say_histogram(each.reply_times)


def _plain(each: Statistics, seconds: float) -> dict[str, Any]:
    times = each.reply_times
    content: dict[str, Any] = {
        "seconds": round(seconds, 3),
        "answered": each.counters["replies"] > 0,
        "counters": {name: each.counters[name] for name in COUNTERS},
        "reply_times": None,
    }
    if times.count:
        content["reply_times"] = {
            "count": times.count,
            **times_ms(times, _PERCENTILES),
            "classes": [
                {"up_to_ms": bound, "count": number}
                for bound, number in zip((*REPLY_TIME_BOUNDS_MS, None), times.classes, strict=True)
            ],
        }
    return content


def _draw_counters(rows: Sequence[tuple[str, Statistics]], seconds: float) -> None:
    others = [name for name in COUNTERS if name not in _ALWAYS_SHOWN and any(each.counters[name] for _, each in rows)]
    columns = [*_ALWAYS_SHOWN, *others]
    _draw(
        ["drive", *columns, "replies/s"],
        [
            [name, *(str(each.counters[one]) for one in columns), f"{each.counters['replies'] / seconds:.1f}"]
            for name, each in rows
        ],
    )


def _draw_times(rows: Sequence[tuple[str, Statistics]]) -> None:
    answering = [(name, each.reply_times) for name, each in rows if each.reply_times.count]
    if not answering:
        return
    say()
    _draw(
        ["reply times", "shortest", "mean", *(f"{percent} %" for percent in _PERCENTILES), "longest"],
        [
            [name, *(f"{time * 1000:.1f} ms" for time in (
                times.shortest_s,
                times.mean_s,
                *(times.percentile_s(percent) for percent in _PERCENTILES),
                times.longest_s,
            ))]
            for name, times in answering
        ],
    )  # fmt: skip


def _draw(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    from rich import box
    from rich.table import Table

    table = Table(box=box.ROUNDED if sys.stdout.isatty() else box.ASCII2)
    for number, head in enumerate(heads):
        table.add_column(head, justify="right" if number else "left", no_wrap=number == 0)
    for row in rows:
        table.add_row(*row)
    print_table(table, _WIDTH)


def _say_histogram(times: ReplyTimes) -> None:
    """Print the classes from the first to the last one with replies."""
    held = [number for number, count in enumerate(times.classes) if count]
    for number in range(held[0], held[-1] + 1):
        lower = REPLY_TIME_BOUNDS_MS[number - 1] if number else 0
        upper = f"{REPLY_TIME_BOUNDS_MS[number]}" if number < len(REPLY_TIME_BOUNDS_MS) else ""
        count = times.classes[number]
        # A class with any reply has a visible bar.
        bar = "#" * max(count > 0, round(count / max(times.classes) * _BAR_WIDTH))
        say(f"{lower:>5} to {upper:<4} ms  {count:>7}  {bar}".rstrip())
