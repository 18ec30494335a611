"""Poll plans as the command line writes them: drives, each followed by its parameters, or a plan file."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from drivecomm.cli.drive_names import KnownPlant, known_plant, parse_drive, parse_settings
from drivecomm.errors import UsageError
from drivecomm.polling import Plan, PlannedDrive, PlannedRead
from drivecomm.protocol import installed, unknown_protocol

if TYPE_CHECKING:
    from drivecomm.cli.line_options import LineOptions
    from drivecomm.plant import Plant, PlantDrive

Words = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="[DRIVE PARAM...]...",
        help="A drive and its parameters, each with ,name=value options, @SECONDS and !PRIORITY behind it.",
    ),
]
PlanFile = Annotated[Path | None, typer.Option("--plan", help="Plan file (.toml) instead of drives and parameters.")]
Period = Annotated[
    float | None, typer.Option("--period", help="Seconds, for parameters without @; 1 if absent, 0 without a pause.")
]

_DRIVE = re.compile(r"([^:,]+):\d+(,.*)?", re.ASCII | re.DOTALL)
_PARAMETER = re.compile(r"(?P<what>[^@!]+)(?:@(?P<period>[^@!]*))?(?:!(?P<priority>[^@!]*))?")
_NEXT_SETTING = re.compile(r",(?=[A-Za-z_-]+=)")


def given_plan(words: list[str], plan_file: Path | None, line: LineOptions, *, period_s: float | None = None) -> Plan:
    """Return the plan of a call; drives that name no port are on that of the call. Raises UsageError.

    Without words and plan file it is what the plant polls. What the command line says of all drives goes before what a
    file says of one. period_s: for parameters on the command line without one of their own, a second if absent.
    """
    if plan_file is not None and words:
        raise UsageError("give a plan file or drives and parameters, not both")
    if plan_file is not None:
        line.refuse(f"the drives are those of {plan_file}", "plant")
        plan = _plan_in(plan_file)
    else:
        # What begins with a name means the plant, whatever port is given.
        begins_with_name = bool(words) and ":" not in words[0].partition(",")[0]
        there = known_plant(line.plant, port_given=line.port is not None and not begins_with_name)
        if there is not None and not words:
            plan = plan_of_plant(there.plant, there.file)
        else:
            plan = parse_plan(words, period_s=1.0 if period_s is None else period_s, known=there)
    if period_s is not None and not words:
        raise UsageError("the plan says how often each is read, so that --period has no effect; leave it out")
    if all(drive.port for drive in plan.drives):
        line.refuse("the plan names the ports of all its drives", "port")
    placed = {
        drive: replace(drive, port=drive.port or line.port or "", options={**drive.options, **line.said_facts})
        for drive in plan.drives
    }
    return replace(plan, reads=tuple(replace(read, drive=placed[read.drive]) for read in plan.reads))


def _plan_in(file: Path) -> Plan:
    """Return the plan in a file: a poll plan, or what a plant file polls."""
    # Loaded by those who have a file only.
    from drivecomm.plant import plant_in  # noqa: PLC0415
    from drivecomm.polling import plan_in  # noqa: PLC0415
    from drivecomm.tomlfile import read_toml  # noqa: PLC0415

    content = read_toml(file, "a poll plan").content
    # Only plants have lines, and only poll plans have polls beside their drives.
    if "line" in content and "poll" not in content:
        return plan_of_plant(plant_in(content, file), str(file))
    return plan_in(content, file)


def plan_of_plant(plant: Plant, file: str) -> Plan:
    """Return what a plant says is polled of its drives. Raises UsageError where nothing is."""
    reads = [
        PlannedRead(drive=_planned(plant, drive), parameter=parameter, period_s=read.period_s, priority=read.priority)
        for drive in plant.drives
        for read in drive.poll
        for parameter in read.parameters
    ]
    if not reads:
        raise UsageError(
            f'{file}: nothing is polled there; write poll = [{{ parameters = ["output_frequency"] }}] in a drive, or '
            "name drives and parameters"
        )
    return Plan(reads=tuple(reads))


def parse_plan(words: list[str], *, period_s: float, known: KnownPlant | None = None) -> Plan:
    """Read `vabus:1 481 482@0.2 fuji:7,model=g11s M09!2`. Raises UsageError.

    known: the plant, whose names stand for its drives; PROTOCOL:ADDRESS is a drive of the plant that has one there.
    """
    drive: PlannedDrive | None = None
    drives: dict[str, PlannedDrive] = {}
    reads: list[PlannedRead] = []
    for word in words:
        if _names_a_drive(word, known):
            drive = _drive(word, known)
            # A drive that is named again goes on with what it had.
            drive = drives.setdefault(word, drive)
        elif drive is None:
            raise UsageError(f"{word!r} names no drive; a plan begins with one, PROTOCOL:ADDRESS, such as vabus:1")
        else:
            reads.append(_read(word, drive, period_s))
    idle = [word for word, one in drives.items() if all(read.drive != one for read in reads)]
    if idle:
        raise UsageError(f"nothing is read of {idle[0]}; name its parameters after it")
    if not reads:
        raise UsageError("nothing to read; name drives and parameters, such as vabus:1 481 482@0.2, or give --plan")
    return Plan(reads=tuple(reads))


def _names_a_drive(word: str, there: KnownPlant | None) -> bool:
    if there is not None and word.partition(",")[0] in {drive.name for drive in there.plant.drives}:
        return True
    protocol, colon, _ = word.partition(",")[0].partition(":")
    if colon and protocol in installed:
        return True
    if _DRIVE.fullmatch(word):
        raise unknown_protocol(protocol, installed)
    return False


def _drive(word: str, known: KnownPlant | None) -> PlannedDrive:
    called, *settings = word.split(",")
    drives = known.plant.drives if known is not None else ()
    if known is not None and any(called in (one.name, f"{one.protocol}:{one.address}") for one in drives):
        planned = _planned(known.plant, known.plant.drive(called))
        return replace(planned, options={**planned.options, **parse_settings(settings)})
    name = parse_drive(word)
    return PlannedDrive(protocol=name.protocol, address=name.address, options=name.options)


def _planned(plant: Plant, drive: PlantDrive) -> PlannedDrive:
    line = plant.line(drive.line)
    return PlannedDrive(
        protocol=drive.protocol,
        address=drive.address,
        options={**line.settings, **drive.options},
        name=drive.name,
        port=line.reached_at,
    )


def _read(word: str, drive: PlannedDrive, period_s: float) -> PlannedRead:
    match = _PARAMETER.fullmatch(word)
    if match is None:
        raise UsageError(f"{word!r} is no parameter; write PARAM[@SECONDS][!PRIORITY], such as 481@0.2!1")
    # A comma may be part of a parameter's address; options follow it as name=value.
    parameter, *settings = _NEXT_SETTING.split(match["what"])
    try:
        period = period_s if match["period"] is None else float(match["period"])
        priority = 0 if match["priority"] is None else int(match["priority"])
    except ValueError:
        raise UsageError(f"{word!r} has no such period or priority; write PARAM@SECONDS!PRIORITY") from None
    return PlannedRead(
        drive=drive, parameter=parameter, period_s=period, priority=priority, options=parse_settings(settings)
    )
