"""Lines and drives of a server, as the server reports them."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from drivecomm.cli.stop.over_bus import StoppedLine
from drivecomm.client import drives_known_to
from drivecomm.protocol import parse_drive

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from drivecomm.cli.line_options import LineArguments
    from drivecomm.client import Registration
    from drivecomm.protocol import DriveConfig


def lines_of_server(server: Registration, line: LineArguments) -> list[StoppedLine]:
    """Return the lines of a server that have drives. Raises LinkError if the server does not report them."""
    found = []
    known = drives_known_to(server)
    for name, port in server.lines.items():
        said = _options_by_drive(server, name)
        there = [each for each in known if each["line"] == name]
        drives = tuple(_drive(each, said.get(each["drive"], {}), line.said_facts) for each in there)
        # A broadcast stop is allowed only if the series of every drive is known.
        whole = all(each["drive"] in said for each in there)
        one = StoppedLine(
            name=name, port=port, opening=line.opening, drives=drives, by_name=not whole, file=server.plant,
            said=line.said_facts,
        )  # fmt: skip
        found.append(one)
    return [each for each in found if each.drives]


def merged(lines: Iterable[StoppedLine], of_server: Iterable[StoppedLine]) -> list[StoppedLine]:
    """Return the lines of a plant file, with the further drives and lines of its server."""
    by_name = {each.name: each for each in lines}
    for each in of_server:
        known = by_name.setdefault(each.name, each)
        have = {str(drive) for drive in known.drives}
        more = tuple(drive for drive in each.drives if str(drive) not in have)
        by_name[each.name] = replace(known, drives=(*known.drives, *more))
    return list(by_name.values())


def _drive(told: Mapping[str, Any], options: Mapping[str, Any], said: Mapping[str, Any]) -> DriveConfig:
    drive = parse_drive(told["drive"])
    return replace(drive, name=told["name"], line=told["line"], options={**options, **said})


def _options_by_drive(server: Registration, line: str) -> dict[str, Mapping[str, Any]]:
    """Return the drive options in the plant file of a server; empty if the file is unreadable now."""
    with suppress(Exception):
        from drivecomm.plant import drives_of

        return {str(each): each.options for each in drives_of(server, line)}
    return {}
