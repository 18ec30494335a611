"""Command `replay`: a capture as drives that answer, or as a master that sends requests."""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING

import click

from drivecomm.capture import read_capture
from drivecomm.cli.line_command import LineCommand
from drivecomm.cli.output import emit, note, print_columns, say, tell
from drivecomm.cli.signals import until_stopped
from drivecomm.cli.values import FILE, NUMBER
from drivecomm.errors import UsageError
from drivecomm.protocol import LineSettings
from drivecomm.traffic.replay import (
    PATIENCE_S,
    ReplayedRequest,
    ReplayMaster,
    Sending,
    by_the_masters_side,
    difference,
    infer_sources,
    recorded_drives,
    recorded_exchanges,
    request_as_text,
)
from drivecomm.traffic.sniffer import protocols_for, recorded_with
from drivecomm.virtual import Server, parse_listen

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from drivecomm.capture import Capture
    from drivecomm.cli.line_options import LineArguments
    from drivecomm.protocol import Protocol


@click.command(cls=LineCommand)
@click.argument("file", type=FILE, help="A capture, .jsonl or .pcapng, or a log that another program printed.")
@click.option(
    "--listen", "-l", metavar="PLACE", help="Answer as recorded, at pty:PATH, tcp:HOST:PORT or rfc2217:HOST:PORT."
)
@click.option("--faster", type=NUMBER, default=1.0, help="Speed as a multiple of the recorded speed.")
@click.option("--commands", is_flag=True, help="Also send what can command or write. This may start a motor.")
def replay(*, line: LineArguments, file: Path, listen: str | None, faster: float, commands: bool) -> int:
    """Replay a capture: with --listen as its drives, otherwise as its master.

    The drives answer as they did then. The master repeats the recorded requests on --port, except those that could
    command or write, and compares the replies. Exit code 1 when one differs.
    """
    recorded = read_capture(file)
    plugins = protocols_for(recorded_with(recorded.provenance))
    for remark in recorded.remarks:
        note(remark)
    codecs = {plugin.name: plugin.codec(plugin.options()) for plugin in plugins}
    capture = infer_sources(by_the_masters_side(recorded, codecs), plugins)
    if listen is not None:
        if faster != 1 or commands:
            raise UsageError("--faster and --commands are for replaying as a master, without --listen")
        line.refuse("with --listen no port is opened")
        return _answer(capture, listen, as_json=line.json)
    if commands:
        line.must_be_armed()
    else:
        line.refuse("without --commands nothing is commanded", "arm")
    settings = [field.name for field in fields(LineSettings)]
    asking = ReplayMaster(
        recorded_exchanges(capture),
        plugins,
        faster=faster,
        sending=Sending.EVERYTHING if commands else Sending.QUESTIONS,
        overrides={name: line.said_facts[name] for name in settings if name in line.said_facts},
        echo=line.echo,
        patience_s=PATIENCE_S if line.timeout is None else line.timeout,
    )
    return _ask(asking, line, plugins)


def _answer(capture: Capture, listen: str, *, as_json: bool) -> int:
    with until_stopped() as stop, Server(recorded_drives(capture), parse_listen(listen)) as server:
        text = f"the drives of the capture on {server.address}; stop with Ctrl-C"
        tell(text, as_json=as_json, listening=server.address, requests=len(recorded_exchanges(capture)))
        server.run(stop)
    if not as_json:
        say("stopped")
    return 0


def _ask(asking: ReplayMaster, line: LineArguments, plugins: Sequence[Protocol]) -> int:
    different: list[ReplayedRequest] = []
    asked = left_out = 0
    line.must_be_free("replay")
    with line.opened() as port:
        for outcome in asking.on(port):
            asked += outcome.sent
            left_out += not outcome.sent
            if outcome.differs:
                different.append(outcome)
            if line.json:
                emit(
                    request=outcome.number,
                    time_s=round(outcome.then.asked_s, 6),
                    data=outcome.then.request,
                    sent=outcome.sent,
                    then=outcome.then.reply,
                    now=outcome.came,
                    difference=difference(outcome, plugins) if outcome.differs else "",
                )
    if line.json:
        emit(asked=asked, different=len(different), left_out=left_out)
    else:
        if different:
            _show(different, plugins)
        say(f"{asked} requests repeated, {len(different)} with a different reply")
        if left_out:
            say(f"{left_out} not sent, because they could command or write; --commands sends them, too")
    return 1 if different else 0


def _show(different: Sequence[ReplayedRequest], plugins: Sequence[Protocol]) -> None:
    """Print the requests that got a different reply, with the differences."""
    rows = [
        (
            f"{each.number:>7}",
            f"{each.then.asked_s:.3f} s",
            request_as_text(each.then.request, plugins),
            difference(each, plugins),
        )
        for each in different
    ]
    print_columns([("request", "time", "asked", "difference"), *rows])
