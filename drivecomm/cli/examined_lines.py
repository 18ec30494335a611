"""The lines that the doctor examines: a port, a line of the plant, or all of them, with the drives said to be there."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from drivecomm.cli.drive_names import known_plant
from drivecomm.commissioning.doctor import Expected

if TYPE_CHECKING:
    from drivecomm.cli.drive_names import KnownPlant
    from drivecomm.cli.line_options import LineOptions
    from drivecomm.link import Echo
    from drivecomm.plant import PlantLine


@dataclass(frozen=True, slots=True, kw_only=True)
class ExaminedLine:
    """A line to examine. name: the plant's, empty for a port that no plant has. drives: those that the plant says."""

    options: LineOptions
    name: str = ""
    drives: tuple[Expected, ...] = ()


def lines_to_examine(line: LineOptions) -> list[ExaminedLine]:
    """Return the line whose port or name in the plant is given, or each line of the plant. Raises UsageError."""
    known = known_plant(line.plant, port_given=False)
    if known is None:
        return [ExaminedLine(options=line)]
    if line.port is None:
        return [_of_the_plant(each, known, line) for each in known.plant.lines]
    named = [each for each in known.plant.lines if line.port in (each.name, each.reached_at)]
    return [_of_the_plant(each, known, replace(line, port=None)) for each in named] or [
        ExaminedLine(options=replace(line, given=line.given | {"port"}))
    ]


def _of_the_plant(each: PlantLine, known: KnownPlant, line: LineOptions) -> ExaminedLine:
    given = {key: value for key, value in line.facts.items() if value is not None}
    echo: Echo = "expect" if each.echo and line.echo == "off" else line.echo
    settings = {key: value for key, value in each.settings.items() if key not in given}
    return ExaminedLine(
        options=replace(line, port=line.port_of(each, known.file), echo=echo, given=line.given | {"port"}, **settings),
        name=each.name,
        drives=tuple(
            Expected(
                name=drive.name,
                protocol=drive.protocol,
                address=drive.address,
                # What is given on the command line goes before what the plant says.
                options={**each.settings, **drive.options, **given},
            )
            for drive in known.plant.on_line(each.name)
        ),
    )
