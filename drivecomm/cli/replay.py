"""The replay command: a capture as drives that answer, or as a master that asks."""

from __future__ import annotations

import sys
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from drivecomm.capture import read_capture
from drivecomm.cli.line_options import LineOptions
from drivecomm.cli.output import emit, say
from drivecomm.cli.signals import until_stopped
from drivecomm.errors import UsageError
from drivecomm.protocol import LineSettings, installed
from drivecomm.traffic.replay import (
    PATIENCE_S,
    ReplayedRequest,
    ReplayMaster,
    Sending,
    described,
    difference,
    infer_sources,
    recorded_drives,
    recorded_exchanges,
)
from drivecomm.virtual import Server, parse_listen

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivecomm.capture import Capture
    from drivecomm.protocol import Protocol


def replay(
    line: LineOptions,
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A capture, .jsonl or .pcapng.")],
    listen: Annotated[
        str | None,
        typer.Option("--listen", "-l", help="Answer as recorded, at pty:PATH, tcp:HOST:PORT or rfc2217:HOST:PORT."),
    ] = None,
    faster: Annotated[float, typer.Option("--faster", help="How many times as fast as recorded.")] = 1.0,
    commands: Annotated[
        bool, typer.Option("--commands", help="Also send what can command or write. This may start a motor.")
    ] = False,
) -> int:
    """Replay a capture: with --listen as its drives, otherwise as its master.

    The drives answer as they did then. The master repeats the recorded requests on --port, except those that could
    command or write, and compares the replies. Exit code 1 when one differs.
    """
    plugins = list(installed.working())
    capture = _read(file, plugins)
    if listen is not None:
        if faster != 1 or commands:
            raise UsageError("--faster and --commands are for replaying as a master, without --listen")
        line.refuse("with --listen no port is opened")
        return _answer(capture, listen, as_json=line.json)
    if commands:
        line.must_be_armed()
    else:
        line.refuse("without --commands nothing is commanded", "arm")
    asking = ReplayMaster(
        recorded_exchanges(capture),
        plugins,
        faster=faster,
        sending=Sending.EVERYTHING if commands else Sending.QUESTIONS,
        overrides=_line_settings(line),
        echo=line.echo,
        patience_s=PATIENCE_S if line.timeout is None else line.timeout,
    )
    return _ask(asking, line, plugins)


def _read(file: Path, plugins: Sequence[Protocol]) -> Capture:
    """Return the capture with who sent what, as far as the protocols tell; say what is missing in the file."""
    capture = read_capture(file)
    for remark in capture.remarks:
        sys.stderr.write(f"drivecomm: {remark}\n")
    return infer_sources(capture, plugins)


def _answer(capture: Capture, listen: str, *, as_json: bool) -> int:
    with until_stopped() as stop, Server(recorded_drives(capture), parse_listen(listen)) as server:
        if as_json:
            emit(listening=server.address, requests=len(recorded_exchanges(capture)))
        else:
            say(f"the drives of the capture on {server.address}; stop with Ctrl-C")
        server.run(stop)
    if not as_json:
        say("stopped")
    return 0


def _line_settings(line: LineOptions) -> dict[str, Any]:
    """Return the line settings that the options give instead of those of the capture."""
    names = [field.name for field in fields(LineSettings)]
    return {name: line.facts[name] for name in names if line.facts[name] is not None}


def _ask(asking: ReplayMaster, line: LineOptions, plugins: Sequence[Protocol]) -> int:
    different: list[ReplayedRequest] = []
    asked = left_out = 0
    with line.opened() as port:
        for outcome in asking.on(port):
            asked += outcome.sent
            left_out += not outcome.sent
            if outcome.differs:
                different.append(outcome)
            if line.json:
                _emit(outcome, plugins)
    if line.json:
        emit(asked=asked, different=len(different), left_out=left_out)
    else:
        _show(different, plugins)
        say(f"{asked} requests asked again, {len(different)} answered differently")
        if left_out:
            say(f"{left_out} not sent, because they could command or write; --commands sends them, too")
    return 1 if different else 0


def _emit(outcome: ReplayedRequest, plugins: Sequence[Protocol]) -> None:
    emit(
        request=outcome.number,
        time_s=round(outcome.then.asked_s, 6),
        data=outcome.then.request,
        sent=outcome.sent,
        then=outcome.then.reply,
        now=outcome.came,
        difference=difference(outcome, plugins) if outcome.differs else "",
    )


def _show(different: Sequence[ReplayedRequest], plugins: Sequence[Protocol]) -> None:
    """Print the requests that were answered differently, and in what."""
    if not different:
        return
    # rich takes a while to load, and a replay without differences needs none of it.
    from rich.console import Console  # noqa: PLC0415
    from rich.table import Table  # noqa: PLC0415
    from rich.text import Text  # noqa: PLC0415

    table = Table(box=None, pad_edge=False)
    for heading in ("request", "time", "asked", "difference"):
        table.add_column(heading, justify="right" if heading in ("request", "time") else "left")
    for outcome in different:
        # A reply may hold square brackets, which are no markup.
        table.add_row(
            str(outcome.number),
            f"{outcome.then.asked_s:.3f} s",
            Text(described(outcome.then.request, plugins)),
            Text(difference(outcome, plugins)),
        )
    Console().print(table)
