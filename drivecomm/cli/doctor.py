"""The doctor command: what an adapter and its line do, and what to do about it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated

import typer

from drivecomm.cli.drive_names import known_plant
from drivecomm.cli.line_options import LineOptions
from drivecomm.cli.options import Addresses, OnlyProtocols, addresses_of
from drivecomm.cli.output import counted, emit, progress_bar, say, sentence
from drivecomm.commissioning.doctor import Finding, judge, measure
from drivecomm.errors import LinkError
from drivecomm.transport import SerialPort

if TYPE_CHECKING:
    from drivecomm.commissioning.doctor import Measurements
    from drivecomm.plant import Plant, PlantLine
    from drivecomm.protocol import DriveConfig
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
            help="Port (or use --port), or name of a line in the plant file. Default: all lines of the plant.",
        ),
    ] = None,
    protocol: OnlyProtocols = None,
    addresses: Addresses = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Only addresses 1 to 4, fewer requests, no other baud rates.")
    ] = False,
) -> int:
    """Examine a port and its line, and say how to fix what is wrong: adapter, noise, echo, drives, reply times.

    Drives of the plant are asked at their own settings, others at the usual ones. Sends only what cannot move a motor.
    Exit code 1 when there is a problem.
    """
    if name is not None and line.port != name:
        line.refuse(f"{name} is the port", "port")
    wanted = addresses_of(addresses) if addresses else list(_QUICK_ADDRESSES) if quick else None
    lines = _lines_to_examine(replace(line, port=name or line.port))
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


@dataclass(frozen=True, slots=True, kw_only=True)
class _ExaminedLine:
    """A line to examine. name: the plant's, empty for a port that no plant has. drives: those that the plant says."""

    options: LineOptions
    name: str = ""
    drives: tuple[DriveConfig, ...] = ()


def _lines_to_examine(line: LineOptions) -> list[_ExaminedLine]:
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


def _of_the_plant(each: PlantLine, known: Plant, line: LineOptions) -> _ExaminedLine:
    return _ExaminedLine(
        options=line.on(each, known.file),
        name=each.name,
        # What is given on the command line goes before what the plant says.
        drives=tuple(each.reached(drive).with_options(**line.said_facts) for drive in known.on_line(each.name)),
    )


def _examined(
    line: _ExaminedLine, *, only: list[str] | None, addresses: list[int] | None, quick: bool
) -> tuple[PortReport | None, Measurements]:
    options = line.options
    with options.opened() as opened, progress_bar("", shown=not options.json) as progress:
        report = opened.report() if isinstance(opened, SerialPort) else None
        return report, measure(
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


def _say(findings: list[Finding]) -> None:
    for one in findings:
        say(f"{_MARKS[one.weight]:<8} {one.about:<7} {one.text}")
        if one.remedy:
            say(f"{'':<16} > {one.remedy}")
    problems = sum(one.weight == "problem" for one in findings)
    say(f"{counted(problems, 'problem') if problems else 'no problems'} found")


def _emit(
    line: _ExaminedLine, measured: tuple[PortReport | None, Measurements] | None, findings: list[Finding]
) -> None:
    for one in findings:
        emit(finding=one.about, weight=one.weight, text=one.text, remedy=one.remedy, line=line.name)
    if measured is None:
        return
    report, found = measured
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
            for one in found.sought
        ],
        noise=[
            {"settings": str(one.settings), "seconds": one.seconds, "data": one.data, "telegrams": one.telegrams}
            for one in found.noise
        ],
        echo=[{"kind": one.kind, "sent": one.sent, "came": one.came, "took_s": one.took_s} for one in found.echo],
        asked={name: str(settings) for name, settings in found.asked.items()},
        drives=[
            {"drive": one.name, "sound": one.sound, "identity": dict(one.identity), "detail": one.detail}
            for one in found.found
        ],
        elsewhere=[{"drive": one.name, "settings": str(settings)} for one, settings in found.elsewhere],
        replies=[
            {
                "drive": one.drive,
                "asked": one.asked,
                "answered": len(one.times_s),
                "times_ms": [round(time * 1000, 3) for time in one.times_s],
                "wire_ms": [round(time * 1000, 3) for time in one.wire_s],
            }
            for one in found.replies
        ],
        unclear_bytes=found.unclear_bytes,
    )
