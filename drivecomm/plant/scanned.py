"""Scan results as a plant: a new file, or further lines and drives in a file that people wrote."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from itertools import count
from pathlib import PurePath
from typing import TYPE_CHECKING

from drivecomm.bus import options_of
from drivecomm.errors import FileFormatError
from drivecomm.plant.editing import with_line_named
from drivecomm.plant.files import read_plant
from drivecomm.plant.plant import Plant, PlantLine
from drivecomm.plant.writing import drive_text, line_text, plant_text
from drivecomm.tomlfile import parse_toml, read_text_file, write_atomically

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Sequence
    from pathlib import Path

    from drivecomm.bus import Found
    from drivecomm.protocol import DriveConfig

_ADVICE = """\
# Written by a scan. Give the drives names, and then:
#   drivecomm status          shows them all
#   drivecomm read NAME ...   reads one of them
# A drive is read-only until it has armed = true.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScannedLine:
    """One line after a scan. port: port of the scan. found: drives that answered. echo: whether the adapter echoes."""

    port: str
    found: Sequence[Found]
    echo: bool = False

    @property
    def sound(self) -> Sequence[Found]:
        """Drives with sound replies; a drive with only damaged replies is left out, because nothing is known of it."""
        return [one for one in self.found if one.sound]

    @property
    def remarks(self) -> dict[str, str]:
        """Reported identity and matching models of each drive, by PROTOCOL:ADDRESS."""
        return {one.name: ", ".join(_remarks_on(one)) for one in self.sound}


def _remarks_on(one: Found) -> list[str]:
    fitting = [] if one.model or not one.candidates else [f"fits model {' or '.join(one.candidates)}"]
    return [*(f"{name} {value}" for name, value in one.identity.items()), *fitting]


def scanned_plant(lines: Iterable[ScannedLine]) -> Plant:
    """Return the plant of some scanned lines; settings that all drives of a line share become settings of the line.

    With several lines, each drive gets a name made of line, protocol and address, since an address alone may exist
    twice.
    """
    scanned = list(lines)
    made: list[PlantLine] = []
    drives: list[DriveConfig] = []
    for each in scanned:
        line = _line_of(each, [line.name for line in made])
        made.append(line)
        drives += [_on(line, one, named=len(scanned) > 1) for one in each.sound]
    return Plant(lines=tuple(made), drives=tuple(drives))


def scanned_text(lines: Sequence[ScannedLine]) -> str:
    """Return the text of a new plant file, with the reported identities of the drives as comments."""
    plant = scanned_plant(lines)
    remarks = {
        drive.name: each.remarks[str(drive)]
        for line, each in zip(plant.lines, lines, strict=True)
        for drive in plant.on_line(line.name)
    }
    damaged = [f"# {one.name} answered with damage only\n" for each in lines for one in each.found if not one.sound]
    return "\n".join([_ADVICE, plant_text(plant, remarks), *damaged])


def add_scanned(file: Path, lines: Iterable[ScannedLine]) -> Sequence[DriveConfig]:
    """Add missing lines and drives to a plant file and return the added drives; everything else stays as it is.

    Raises FileFormatError for a file that cannot be read or written, or that writes its lines or drives as one list.
    """
    plant, text = read_plant(file), read_text_file(file, "a plant")
    added, parts, names = [], list[str](), [line.name for line in plant.lines]
    for each in lines:
        line = next((known for known in plant.lines if each.port in (known.port, known.reached_at)), None)
        known = [] if line is None else [str(drive) for drive in plant.on_line(line.name)]
        new = [one for one in each.sound if one.name not in known]
        if line is None:
            line = _line_of(each, names)
            names.append(line.name)
            parts.append(line_text(line))
        for one in new:
            drive = _on(line, one, named=True)
            parts.append(drive_text(drive, each.remarks[one.name], with_line=True))
            added.append(drive)
    if len(plant.lines) == 1:
        text = with_line_named(text, plant.lines[0].name)
    changed = "\n".join([text.rstrip("\n") + "\n", *parts])
    _check_adds(file, changed, plant, added)
    if parts:
        write_atomically(file, changed)
    return added


def line_name(port: str) -> str:
    """Return a line name derived from the port: ttyUSB0, COM3, hall-4001; "line" if the port has no letters."""
    place = port.partition("://")[2] or PurePath(port).name
    return re.sub(r"[^A-Za-z0-9_.]+", "-", place.partition("?")[0]).strip("-") or "line"


def _line_of(scanned: ScannedLine, taken: Collection[str]) -> PlantLine:
    met = {one.settings for one in scanned.sound}
    shared = next(iter(met)) if len(met) == 1 else None
    usual = line_name(scanned.port)
    name = next(name for number in count(1) if (name := usual if number == 1 else f"{usual}-{number}") not in taken)
    settings = {} if shared is None else options_of(shared)
    return PlantLine(name=name, port=scanned.port, echo=scanned.echo, settings=settings)


def _on(line: PlantLine, one: Found, *, named: bool) -> DriveConfig:
    """Return a drive of a line, with only those settings that differ from the line's."""
    drive = one.drive
    own = {name: value for name, value in drive.options.items() if line.settings.get(name) != value}
    name = f"{line.name}-{one.protocol}-{one.address}" if named else drive.name
    return replace(drive, name=name, line=line.name, options=own)


def _check_adds(file: Path, text: str, plant: Plant, added: Sequence[DriveConfig]) -> None:
    """Raise FileFormatError unless a text has the expected number of drives."""
    try:
        content = parse_toml(text, str(file))
        done = len(content.get("drive", [])) == len(plant.drives) + len(added)
    except FileFormatError:
        done = False
    if not done:
        raise FileFormatError(
            f"{file}: nothing can be added, because its lines or drives stand in one list; write each as a "
            "[[line]] or [[drive]] of its own, or scan into another file"
        )
