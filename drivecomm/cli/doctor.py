"""The doctor command: what an adapter and its line do, and what to do about it."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated

import typer

from drivecomm.cli.address_lists import addresses_of
from drivecomm.cli.line_options import LineOptions
from drivecomm.cli.output import emit, say, sentence
from drivecomm.errors import LinkError

if TYPE_CHECKING:
    from drivecomm.cli.examined_lines import ExaminedLine
    from drivecomm.commissioning.doctor import Examination, Finding
    from drivecomm.link import Port
    from drivecomm.transport import PortReport

_QUICK_ADDRESSES = range(1, 5)
_QUICK_PROBES = 10
_PROBES = 24
_MARKS = {"fine": "ok", "note": "note", "problem": "PROBLEM"}


def doctor(
    line: LineOptions,
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="[PORT]",
            help="The port (--port does as well), or a line of the plant by its name. If absent: each of them.",
        ),
    ] = None,
    protocol: Annotated[list[str] | None, typer.Option("--protocol", help="Only these; repeat it for more.")] = None,
    addresses: Annotated[str | None, typer.Option("--addresses", "-a", help="Such as 1-31 or 1,5,7-9.")] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Addresses 1 to 4 only, fewer questions, no other baud rates.")
    ] = False,
) -> int:
    """Examine a port and its line: adapter, noise, echo, who answers, how fast; with a remedy for what is wrong.

    The drives that the plant has on the line are asked at their own settings; others at the usual ones. Sends only what
    cannot move a motor. Exit code 1 when there is a problem.
    """
    from drivecomm.cli.examined_lines import lines_to_examine  # noqa: PLC0415 - only this command needs them
    from drivecomm.commissioning.doctor import Finding, judge  # noqa: PLC0415

    if name is not None and line.port != name:
        line.refuse(f"{name} is the port", "port")
    wanted = addresses_of(addresses) if addresses else list(_QUICK_ADDRESSES) if quick else None
    lines = lines_to_examine(replace(line, port=name or line.port))
    sound = True
    for each in lines:
        if len(lines) > 1 and not line.json:
            say(f"{each.name}, {each.options.named_port}")
        measured = None
        try:
            measured = _examined(each, only=protocol or None, addresses=wanted, quick=quick)
            findings = judge(measured[1], measured[0])
        except LinkError as error:
            if len(lines) == 1:
                raise
            # The other lines are examined all the same.
            findings = [Finding(weight="problem", about="port", text=sentence(error))]
        sound = sound and all(one.weight != "problem" for one in findings)
        if line.json:
            _emit(each, measured, findings)
        else:
            _say(findings)
    return 0 if sound else 1


def _examined(
    line: ExaminedLine, *, only: list[str] | None, addresses: list[int] | None, quick: bool
) -> tuple[PortReport | None, Examination]:
    from drivecomm.commissioning.doctor import examine  # noqa: PLC0415 - only this command needs it

    options = line.options
    with options.opened() as opened, _progress(shown=not options.json) as progress:
        report = _report(opened)
        return report, examine(
            opened,
            only=only,
            addresses=addresses,
            expected=[one for one in line.drives if not only or one.protocol in only],
            echo=options.echo,
            probes=_QUICK_PROBES if quick else _PROBES,
            search=not quick,
            trace=options.shown_trace,
            progress=progress,
            **options.facts,
        )


def _report(port: Port) -> PortReport | None:
    from drivecomm.transport import SerialPort  # noqa: PLC0415 - loads pyserial

    return port.report() if isinstance(port, SerialPort) else None


@contextmanager
def _progress(*, shown: bool) -> Iterator[Callable[[str, int, int], None]]:
    """Yield what shows how far it is, on standard error, where the findings are not."""
    from rich.console import Console  # noqa: PLC0415 - rich is loaded only where something is drawn
    from rich.progress import BarColumn, Progress, TextColumn  # noqa: PLC0415

    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn())
    with Progress(*columns, console=console, transient=True, disable=not (shown and sys.stderr.isatty())) as progress:
        task = progress.add_task("opening", total=None)

        def show(what: str, done: int, of: int) -> None:
            progress.update(task, description=what, completed=done, total=of)

        yield show


def _say(findings: list[Finding]) -> None:
    for one in findings:
        say(f"{_MARKS[one.weight]:<8} {one.about:<7} {one.text}")
        if one.remedy:
            say(f"{'':<16} > {one.remedy}")
    problems = sum(one.weight == "problem" for one in findings)
    say(f"{problems or 'no'} problem{'' if problems == 1 else 's'} found")


def _emit(line: ExaminedLine, measured: tuple[PortReport | None, Examination] | None, findings: list[Finding]) -> None:
    for one in findings:
        emit(finding=one.about, weight=one.weight, text=one.text, remedy=one.remedy, line=line.name)
    if measured is None:
        return
    report, examination = measured
    emit(
        port=line.options.named_port,
        line=line.name,
        report=report,
        expected=[
            {
                "name": one.drive.name,
                "drive": f"{one.drive.protocol}:{one.drive.address}",
                "settings": str(one.settings),
                "answers": not one.error,
                "elsewhere": str(one.elsewhere or ""),
                "error": one.error,
            }
            for one in examination.sought
        ],
        noise=[
            {"settings": str(one.settings), "seconds": one.seconds, "data": one.data, "telegrams": one.telegrams}
            for one in examination.noise
        ],
        echo=[{"kind": one.kind, "sent": one.sent, "came": one.came, "took_s": one.took_s} for one in examination.echo],
        asked={name: str(settings) for name, settings in examination.asked.items()},
        drives=[
            {"drive": one.name, "sound": one.sound, "identity": dict(one.identity), "detail": one.detail}
            for one in examination.found
        ],
        elsewhere=[{"drive": found.name, "settings": str(settings)} for found, settings in examination.elsewhere],
        replies=[
            {
                "drive": one.drive,
                "asked": one.asked,
                "answered": len(one.times_s),
                "times_ms": [round(time * 1000, 3) for time in one.times_s],
                "wire_ms": [round(time * 1000, 3) for time in one.wire_s],
            }
            for one in examination.replies
        ],
        unclear_bytes=examination.unclear_bytes,
    )
