"""Stop of several drives and groups by name: all their lines concurrently, and no other drive."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from drivecomm.bus import StopResult
from drivecomm.cli.stop.concurrent_lines import stop_lines
from drivecomm.cli.stop.groups import PlacedDrives, group_to_stop
from drivecomm.cli.stop.one_drive import reached_for_stopping
from drivecomm.cli.stop.over_bus import StoppedLine
from drivecomm.cli.stop.results import show
from drivecomm.cli.stop.safe_lookups import SafeLookups
from drivecomm.cli.stop.server_drives import ServerDrives
from drivecomm.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivecomm.cli.line_options import LineArguments
    from drivecomm.protocol import Stop


def stop_several(line: LineArguments, names: Sequence[str], model: str | None, how: Stop) -> int:
    """Stop drives and groups, and print for each drive whether it has confirmed; return the exit code.

    An unknown name is reported, and does not prevent the other stops.
    """
    spite = SafeLookups(as_json=line.json)
    servers = ServerDrives(line, spite)
    found, unknown = [], False
    for text in dict.fromkeys(names):
        try:
            found.append(_placed(line, text, servers, spite))
        except Exception as error:  # noqa: BLE001 - the other drives must still be stopped
            unknown = True
            show(StopResult(drive=text, how=how, error=error), how, as_json=line.json)
    code = stop_placed(line, found, model, how, spite)
    return UsageError.exit_code if unknown and code == 0 else code


def stop_placed(
    line: LineArguments, found: Sequence[PlacedDrives], model: str | None, how: Stop, spite: SafeLookups
) -> int:
    """Stop drives, each once, and print for each whether it has confirmed; return the exit code."""
    chosen = {"model": model} if model else {}
    lines: dict[str, StoppedLine] = {}
    for each in found:
        for name, error in each.unreached.items():
            show(StopResult(drive=name, how=how, error=error), how, as_json=line.json)
        for port, opening, drive in each.places:
            one = lines.get(port) or StoppedLine(port=port, opening=opening, by_name=True)
            if str(drive) not in map(str, one.drives):
                named = replace(drive, options={**drive.options, **chosen})
                lines[port] = replace(one, drives=(*one.drives, named))
    if not lines:
        return UsageError.exit_code
    whole = all(each.whole and not each.unreached for each in found)
    return stop_lines(list(lines.values()), line, how, spite, whole=whole)


def _placed(line: LineArguments, text: str, servers: ServerDrives, spite: SafeLookups) -> PlacedDrives:
    """Return the drive or the group that a word names. Raises the error for an unknown name."""
    try:
        reached, drive, broken = reached_for_stopping(line, text, spite)
    except Exception as error:
        if (group := group_to_stop(line, text, servers, spite)) is not None:
            return group
        known = servers.named(text)
        if known is None:
            raise
        spite.note(error)
        return PlacedDrives(places=known.places(line))
    if broken:
        spite.note(broken)
    return PlacedDrives(places=[(reached.named_port, reached.opening, drive)])
