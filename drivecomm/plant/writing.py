"""Plants as the text of a file that `drivecomm.plant.files` reads and that people edit further."""

from __future__ import annotations

from dataclasses import asdict
from itertools import count
from typing import TYPE_CHECKING, Any

from drivecomm.tomlfile import toml_line

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.plant.plant import Plant, PlantLine
    from drivecomm.protocol import DriveConfig, PollGroup


def plant_text(plant: Plant, remarks: Mapping[str, str] | None = None) -> str:
    """Return the facts of a plant that masters need as the text of a file: lines, drives, and permissions.

    remarks: comments on drives, by their names. Facts for virtual drives only (values, motors, faults, the address at
    which a line listens) are left out. A drive that is named after its address gets a commented-out name to fill in.
    """
    parts = ["format = 1\n"]
    parts += [line_text(line) for line in plant.lines]
    only = len(plant.lines) == 1
    taken = {drive.name for drive in plant.drives}
    free = (name for number in count(1) if (name := f"pump{number}") not in taken)
    for drive in plant.drives:
        remark = (remarks or {}).get(drive.name, "")
        hint = next(free) if drive.name == str(drive) else ""
        parts.append(drive_text(drive, remark, with_line=not only, name_hint=hint))
    return "\n".join(parts)


def line_text(line: PlantLine) -> str:
    """Return a line as its table in a plant file."""
    return _entry("line", _line(line))


def drive_text(drive: DriveConfig, remark: str = "", *, with_line: bool, name_hint: str = "") -> str:
    """Return a drive as its table in a plant file. remark: a comment in it. name_hint: name in a comment."""
    return _entry("drive", _drive(drive, with_line=with_line), remark, name_hint)


def _line(line: PlantLine) -> dict[str, Any]:
    return {**_said({"name": line.name, "port": line.port, "echo": line.echo}), **line.settings}


def _drive(drive: DriveConfig, *, with_line: bool) -> dict[str, Any]:
    return _said(
        {
            "name": "" if drive.name == str(drive) else drive.name,
            "drive": str(drive),
            "line": drive.line if with_line else "",
            "title": drive.title,
            "groups": list(drive.groups),
            "options": dict(drive.options),
            "armed": drive.armed,
            "confirmed": list(drive.confirmed),
            "reply_delay_s": drive.reply_delay_s,
            "poll": [_poll_group(each) for each in drive.poll],
            "link_loss": asdict(drive.link_loss) if drive.link_loss else {},
            "tags": {name: _said(asdict(each)) for name, each in drive.tags.items()},
            "machine": dict(drive.machine.content) if drive.machine else {},
            "network": {**drive.network.verbs, **_said({"write": drive.network.write})},
        }
    )


def _poll_group(group: PollGroup) -> dict[str, Any]:
    options = {"options": dict(group.options)} if group.options else {}
    return {"parameters": list(group.parameters), "period_s": group.period_s, "priority": group.priority, **options}


def _said(content: dict[str, Any]) -> dict[str, Any]:
    """Return the content without empty values; numbers are kept, including 0."""
    return {key: value for key, value in content.items() if value or type(value) in (int, float)}


def _entry(kind: str, content: Mapping[str, Any], remark: str = "", name_hint: str = "") -> str:
    lines = [f"[[{kind}]]"]
    if remark:
        # A comment must not have control characters, even if a drive reports some.
        lines.append("# " + "".join(each for each in " ".join(remark.split()) if each.isprintable()))
    if name_hint:
        lines.append(f'# name = "{name_hint}"')
    lines += [toml_line(key, value) for key, value in content.items()]
    return "\n".join(lines) + "\n"
