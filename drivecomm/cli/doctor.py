"""Command `doctor`: measurements of an adapter and its line, with remedies."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import click

from drivecomm.cli import options
from drivecomm.cli.drive_names import known_plant
from drivecomm.cli.line_command import LineCommand
from drivecomm.cli.output import counted, emit, progress_bar, say, sentence
from drivecomm.commissioning.doctor import DoctorFinding, judge, measure, measured_content
from drivecomm.errors import LinkError
from drivecomm.transport import SerialPort

if TYPE_CHECKING:
    from drivecomm.cli.line_options import LineArguments
    from drivecomm.cli.output import Progress
    from drivecomm.plant import Plant, PlantLine
    from drivecomm.protocol import DriveConfig

_QUICK_ADDRESSES = range(1, 5)
_QUICK_PROBES = 10
_PROBES = 24
_MARKS = {"fine": "ok", "note": "note", "problem": "PROBLEM"}


@click.command(cls=LineCommand)
@click.argument(
    "name",
    metavar="[PORT]",
    required=False,
    help="Port (or use --port), or name of a line in the plant file. Default: all lines of the plant.",
)
@options.only_protocols
@options.addresses
@click.option("--quick", is_flag=True, help="Only addresses 1 to 4, fewer requests, no other baud rates.")
@click.option(
    "--all-protocols",
    is_flag=True,
    help="Look for drives of all protocols on a line of the plant, and at other baud rates through a server.",
)
def doctor(
    *,
    line: LineArguments,
    name: str | None,
    protocol: tuple[str, ...],
    addresses: list[int] | None,
    quick: bool,
    all_protocols: bool,
) -> int:
    """Examine a port and its line, and suggest fixes for problems: adapter, noise, echo, drives, reply times.

    Drives of the plant are asked first, at their own settings. The search for others on their line is limited to the
    same protocols, unless --all-protocols is given. Sends only telegrams that cannot move a motor. Exit code 1 if there
    is a problem.
    """
    if name is not None and line.port != name:
        line.refuse(f"{name} is the port", "port")
    wanted = addresses or (list(_QUICK_ADDRESSES) if quick else None)
    lines = _lines_to_examine(replace(line, port=name or line.port))
    sound = True
    for each in lines:
        if len(lines) > 1 and not line.json:
            say(f"{each.name}, {each.options.named_port}")
        measured = None
        try:
            only = list(protocol) or (None if all_protocols else _protocols_of(each.drives))
            findings, measured = _examined(each, only=only, addresses=wanted, quick=quick, everything=all_protocols)
        except LinkError as error:
            if len(lines) == 1:
                raise
            # Other lines are examined even if this one fails.
            findings = [DoctorFinding(weight="problem", about="port", text=sentence(error))]
        sound = sound and all(one.weight != "problem" for one in findings)
        if line.json:
            _emit(each, measured, findings)
        else:
            _say(findings)
    return 0 if sound else 1


@dataclass(frozen=True, slots=True, kw_only=True)
class _ExaminedLine:
    """Line to examine. name: name in the plant, empty for a port without plant. drives: drives of the plant on it."""

    options: LineArguments
    name: str = ""
    drives: tuple[DriveConfig, ...] = ()


def _lines_to_examine(line: LineArguments) -> list[_ExaminedLine]:
    """Return the line whose port or name in the plant is given, or each line of the plant. Raises UsageError."""
    known = known_plant(line.plant, port_given=False)
    if known is None:
        return [_ExaminedLine(options=line)]
    if line.port is None:
        return [_of_the_plant(each, known, line) for each in known.lines]
    named = [each for each in known.lines if line.port in (each.name, each.reached_at)]
    return [_of_the_plant(each, known, replace(line, port=None)) for each in named] or [
        _ExaminedLine(options=replace(line, given=line.given | {"port"}))
    ]


def _of_the_plant(each: PlantLine, known: Plant, line: LineArguments) -> _ExaminedLine:
    return _ExaminedLine(
        options=line.on(each, known.file),
        name=each.name,
        # Settings of the command line override those of the plant.
        drives=tuple(each.reached(drive).with_options(**line.said_facts) for drive in known.on_line(each.name)),
    )


def _protocols_of(drives: tuple[DriveConfig, ...]) -> list[str] | None:
    """Return the protocols of the drives of a line; None for a line that no plant describes."""
    return list(dict.fromkeys(each.protocol for each in drives)) or None


def _examined(
    line: _ExaminedLine, *, only: list[str] | None, addresses: list[int] | None, quick: bool, everything: bool
) -> tuple[list[DoctorFinding], dict[str, Any]]:
    """Return the findings on a line and their measurements; through the server that has the port, if any."""
    options = line.options
    probes, search = _QUICK_PROBES if quick else _PROBES, not quick
    with progress_bar("", shown=not options.json) as progress:
        if options.server is not None:
            # Trying other baud rates disturbs the server's polls, so it needs a request of the user.
            asked = {"only": only, "addresses": addresses, "probes": probes, "search": search, "rates": everything}
            return _examined_by_server(options, {**asked, "options": options.said_facts}, progress)
        with options.opened() as opened:
            report = opened.report() if isinstance(opened, SerialPort) else None
            found = measure(
                opened,
                only=only,
                addresses=addresses,
                expected=[one for one in line.drives if not only or one.protocol in only],
                echo=options.echo,
                probes=probes,
                search=search,
                trace=options.shown_trace,
                progress=progress,
                **options.facts,
            )
    return list(judge(found, report)), measured_content(report, found)


def _examined_by_server(
    options: LineArguments, asked: dict[str, Any], progress: Progress
) -> tuple[list[DoctorFinding], dict[str, Any]]:
    from drivecomm.client import examination_results

    findings, measured = [], {}
    # The server reports the trace of the line only while the bus is open.
    with options.bus() as bus:
        for each in examination_results(bus, asked, progress):
            if "finding" in each:
                findings.append(DoctorFinding(**each["finding"]))
            else:
                measured = each["measured"]
    return findings, measured


def _say(findings: list[DoctorFinding]) -> None:
    for one in findings:
        say(f"{_MARKS[one.weight]:<8} {one.about:<7} {one.text}")
        if one.remedy:
            say(f"{'':<16} > {one.remedy}")
    problems = sum(one.weight == "problem" for one in findings)
    say(f"{counted(problems, 'problem') if problems else 'no problems'} found")


def _emit(line: _ExaminedLine, measured: dict[str, Any] | None, findings: list[DoctorFinding]) -> None:
    for one in findings:
        emit(finding=one.about, weight=one.weight, text=one.text, remedy=one.remedy, line=line.name)
    if measured is not None:
        emit(port=line.options.named_port, line=line.name, **measured)
