"""Command `simulate`: virtual drives for other programs, in real time."""

from __future__ import annotations

from contextlib import ExitStack, contextmanager
from math import inf
from typing import TYPE_CHECKING

import click

from drivecomm.cli import options
from drivecomm.cli.commands import CliCommand
from drivecomm.cli.output import counted, emit, note, say, show_traced
from drivecomm.cli.output_files import must_be_new
from drivecomm.cli.signals import until_stopped
from drivecomm.cli.value_files import recorded
from drivecomm.cli.values import FILE, NUMBER
from drivecomm.errors import DriveCommError, FileFormatError, UsageError
from drivecomm.plant import Plant, PlantLine, read_plant, script_of, unreadable_polls
from drivecomm.protocol import parse_drive
from drivecomm.virtual import SERVED_TOLERANCE_S, PlantRecord, PlantServer, VirtualPlant, separate_drive_keys

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_ANY_PORT = "127.0.0.1:0"


@click.command(cls=CliCommand)
@click.argument("plant", type=FILE, required=False, help="A plant file: lines, drives, faults.")
@click.option("--drive", "-d", metavar="DRIVE", multiple=True, help="PROTOCOL:ADDRESS[,model=...]; repeatable.")
@click.option(
    "--listen",
    "-l",
    metavar="PLACE",
    show_default=False,
    default="",
    help="pty:PATH, tcp:HOST:PORT or rfc2217:HOST:PORT.",
)
@click.option("--listeners", is_flag=True, help="At tcp, let clients beside the master listen to the line.")
@click.option(
    "--fault", "-f", multiple=True, metavar="FAULT", help="As [[fault]]: 'kind = \"drop\", every = 3'; repeatable."
)
@click.option("--echo", is_flag=True, help="Echo what the master sends, as some adapters do.")
@click.option("--paced", is_flag=True, help="Characters take as long as on a real line.")
@click.option(
    "--speed", type=NUMBER, metavar="N", default=1.0, help="Run motors and faults N times as fast, but not the lines."
)
@click.option(
    "--control",
    show_default=False,
    metavar="PLACE",
    default="",
    help="Control socket for drivecomm plant: HOST:PORT or unix:PATH.",
)
@click.option("--trace", is_flag=True, help="Show every telegram, decoded, with its time.")
@click.option("--record", type=FILE, help="Record what is on the lines: .jsonl or .pcapng.")
@options.json
def simulate(
    *,
    plant: Path | None,
    drive: tuple[str, ...],
    listen: str,
    listeners: bool,
    fault: tuple[str, ...],
    echo: bool,
    paced: bool,
    speed: float,
    control: str,
    trace: bool,
    record: Path | None,
    json: bool,
) -> int:
    """Serve virtual drives to other programs until Ctrl-C or SIGTERM, as on a real line.

    Give a plant file, or one line with --drive and --listen. A plant file always has a control socket, at a free port
    of this machine unless --control says where.
    """
    if plant is None:
        if not drive or not listen:
            raise UsageError("nothing to simulate; name a plant file, or at least one --drive and --listen")
        lines = (PlantLine(name="line", listen=listen, listeners=listeners, echo=echo, paced=paced),)
        drives = tuple(separate_drive_keys(parse_drive(text), line="line") for text in drive)
        script = script_of(fault, line="line", drives=[each.name for each in drives])
        planned = Plant(lines=lines, drives=drives, script=script)
        server = PlantServer(VirtualPlant(planned, speed=speed), control=control)
    elif drive or listen or listeners or fault or echo or paced:
        raise UsageError(
            "the plant file has drives, faults, listen, listeners, echo and paced; leave these options out"
        )
    else:
        virtual = read_plant(plant)
        for text in unreadable_polls(virtual):
            note(f"{plant}: {text}")
        try:
            server = PlantServer(VirtualPlant(virtual, speed=speed), control=control or _ANY_PORT)
        except DriveCommError as error:
            raise FileFormatError(f"{plant}: {error}") from error
    if record is not None:
        must_be_new(record)
    with until_stopped() as stop, _recording(server, record, as_json=json), _traced(server, wanted=trace, as_json=json):
        (_emit if json else _say)(server, plant)
        server.run(stop)
    if not json:
        say("stopped")
    return 0


@contextmanager
def _recording(server: PlantServer, path: Path | None, *, as_json: bool) -> Iterator[None]:
    """Run the server for the time of the block, and record to a file if a path is given."""
    with ExitStack() as opened:
        if path is not None:
            opened.enter_context(recorded(path, as_json=as_json))
            record = PlantRecord(server.plant, path)
            opened.enter_context(server)
            opened.enter_context(record)
        else:
            opened.enter_context(server)
        yield


@contextmanager
def _traced(server: PlantServer, *, wanted: bool, as_json: bool) -> Iterator[None]:
    """Print the telegrams of the block, including the last ones."""
    if not wanted:
        yield
        return
    traces = server.plant.watch(tolerance_s=SERVED_TOLERANCE_S)
    shown = dict.fromkeys(traces, 0)

    def show(*, ended_by: float) -> None:
        for name, trace in traces.items():
            for each in trace.since(shown[name], ended_by=ended_by):
                shown[name] = each.number
                text = f"{name}  {each}" if len(traces) > 1 else str(each)
                show_traced({"trace": "telegram", "line": name, **each.as_object()} if as_json else text)

    server.on_tick.append(lambda: show(ended_by=server.now()))
    try:
        yield
    finally:
        show(ended_by=inf)


def _say(server: PlantServer, path: Path | None) -> None:
    steered = f"; control at {server.control}" if server.control else ""
    if path is not None:
        plant = server.plant.plant
        size = f"{counted(len(plant.lines), 'line')}, {counted(len(plant.drives), 'drive')}"
        say(f"{path}: {size}{steered}; stop with Ctrl-C")
    for line, address in server.addresses.items():
        names = ", ".join(_drives_on(server, line))
        if path is None:
            say(f"{names} on {address}{steered}; stop with Ctrl-C")
        else:
            say(f"{line} on {address}: {names or 'no drive'}")


def _emit(server: PlantServer, path: Path | None) -> None:
    control = {"control": server.control} if server.control else {}
    lines = [
        {"line": line, "listening": address, "drives": _drives_on(server, line)}
        for line, address in server.addresses.items()
    ]
    if path is None:
        del lines[0]["line"]
        emit(**lines[0], **control)
    else:
        emit(plant=str(path), lines=lines, **control)


def _drives_on(server: PlantServer, line: str) -> list[str]:
    return [drive.name for drive in server.plant.plant.on_line(line)]
