"""Plants as the text of a file that `drivecomm.plant.files` reads, and that people go on with."""

from __future__ import annotations

import re
from dataclasses import asdict, replace
from itertools import count
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

from drivecomm.bus import options_of
from drivecomm.plant.plant import Plant, PlantLine
from drivecomm.tomlfile import toml_line

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from drivecomm.bus import Found
    from drivecomm.protocol import DriveConfig, PollGroup

_ADVICE = """\
# Written by a scan. Give the drives names (take away the # before name, and change it), and then:
#   drivecomm status          shows them all
#   drivecomm read NAME ...   reads one of them
# A drive is read-only until it has armed = true.
"""


def plant_of_found(found: Iterable[Found], *, port: str, echo: bool = False) -> Plant:
    """Return the plant that a scan of one line has found; settings that all drives share are the line's.

    A drive that answered with damage only is left out: nothing is known of it.
    """
    sound = [one for one in found if one.sound]
    met = {one.settings for one in sound}
    shared = next(iter(met)) if len(met) == 1 else None
    settings = {} if shared is None else options_of(shared)
    line = PlantLine(name=line_name(port), port=port, echo=echo, settings=settings)
    own = [replace(one, settings=None).drive if settings else one.drive for one in sound]
    return Plant(lines=(line,), drives=tuple(replace(drive, line=line.name) for drive in own))


def line_name(port: str) -> str:
    """Return what a line is called after its port: ttyUSB0, COM3, hall-4001; "line" after one without letters."""
    place = port.partition("://")[2] or PurePath(port).name
    return re.sub(r"[^A-Za-z0-9_.]+", "-", place.partition("?")[0]).strip("-") or "line"


def plant_text(plant: Plant, remarks: Mapping[str, str] | None = None) -> str:
    """Return what masters need of a plant as the text of a file: lines, drives, and what may be done with them.

    remarks: comments to drives by their names. What is said for virtual drives only (values, motors, faults, where a
    line listens) is left out. A drive that is named after its address gets no name, but a place for one.
    """
    parts = ["format = 1\n"]
    parts += [_entry("line", _line(line)) for line in plant.lines]
    only = len(plant.lines) == 1
    taken = {drive.name for drive in plant.drives}
    free = (name for number in count(1) if (name := f"pump{number}") not in taken)
    for drive in plant.drives:
        remark = (remarks or {}).get(drive.name, "")
        content = _drive(drive, with_line=not only)
        parts.append(_entry("drive", content, remark, name_hint="" if "name" in content else next(free)))
    return "\n".join(parts)


def found_text(found: Sequence[Found], *, port: str, echo: bool = False) -> str:
    """Return the text of a plant file for what a scan has found, with what the drives tell of themselves as remarks."""
    told = {
        one.name: ", ".join(f"{name} {value}" for name, value in one.identity.items()) for one in found if one.sound
    }
    damaged = [f"# {one.name} answered with damage only\n" for one in found if not one.sound]
    text = plant_text(plant_of_found(found, port=port, echo=echo), told)
    return "\n".join([_ADVICE, text, *damaged])


def _line(line: PlantLine) -> dict[str, Any]:
    return {**_said({"name": line.name, "port": line.port, "echo": line.echo}), **line.settings}


def _drive(drive: DriveConfig, *, with_line: bool) -> dict[str, Any]:
    return _said(
        {
            "name": "" if drive.name == str(drive) else drive.name,
            "drive": str(drive),
            "line": drive.line if with_line else "",
            "title": drive.title,
            "options": dict(drive.options),
            "armed": drive.armed,
            "reply_delay_s": drive.reply_delay_s,
            "poll": [_poll_group(each) for each in drive.poll],
            "link_loss": asdict(drive.link_loss) if drive.link_loss else {},
            "network": {**drive.network.verbs, **_said({"write": drive.network.write})},
        }
    )


def _poll_group(group: PollGroup) -> dict[str, Any]:
    options = {"options": dict(group.options)} if group.options else {}
    return {"parameters": list(group.parameters), "period_s": group.period_s, "priority": group.priority, **options}


def _said(content: dict[str, Any]) -> dict[str, Any]:
    """Return what says something; a number does, also 0."""
    return {key: value for key, value in content.items() if value or type(value) in (int, float)}


def _entry(kind: str, content: Mapping[str, Any], remark: str = "", name_hint: str = "") -> str:
    lines = [f"[[{kind}]]"]
    if remark:
        # A comment has no control characters, whatever a drive tells.
        lines.append("# " + "".join(each for each in " ".join(remark.split()) if each.isprintable()))
    if name_hint:
        lines.append(f'# name = "{name_hint}"')
    lines += [toml_line(key, value) for key, value in content.items()]
    return "\n".join(lines) + "\n"
