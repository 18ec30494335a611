"""Stop of everything, or of all drives of a protocol: on all lines concurrently, broadcasts first.

A broadcast reaches every drive with one telegram, but no drive confirms it. Therefore each drive of the plant is then
stopped individually. The first round stops each drive once and waits for a silent drive no longer than one reply takes.
The second round repeats unconfirmed stops with all their attempts. A server stops all its drives concurrently.
"""

from __future__ import annotations

import os
from dataclasses import replace
from typing import TYPE_CHECKING

from drivecomm.cli.stop.concurrent_lines import stop_lines
from drivecomm.cli.stop.damaged_file import readable_plant
from drivecomm.cli.stop.one_drive import stop_one
from drivecomm.cli.stop.over_bus import StoppedLine
from drivecomm.cli.stop.safe_lookups import SafeLookups
from drivecomm.cli.stop.whole_port import stop_port
from drivecomm.client import server_of_plant
from drivecomm.errors import FileFormatError, UsageError
from drivecomm.protocol import installed, unknown_protocol

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

    from drivecomm.cli.line_options import LineArguments
    from drivecomm.plant import Plant
    from drivecomm.protocol import DriveConfig, Stop


def stop_all(line: LineArguments, path: Path | None, how: Stop) -> int:
    """Stop all drives at the port or in the plant file, and print the confirmations; return the exit code.

    A drive that does not support this kind of stop is stopped down its ramp. Line facts of the command line override
    those of the plant. If the plant file is unreadable, its server supplies the drives; without a server, only the
    given port remains.
    """
    spite = SafeLookups(as_json=line.json)
    if path is None:
        return stop_port(line, how, spite)
    of_server = _of_server(line, path, spite)
    try:
        plant, whole = _plant(path, spite)
    except Exception as error:
        if not of_server and line.port is None:
            raise
        code = stop_lines(of_server, line, how, spite, whole=True) if of_server else FileFormatError.exit_code
        if not of_server:
            stop_port(line, how, spite)
        spite.note(error)
        return code
    # The server of a damaged file may know more drives.
    lines = list(_lines_of(plant, line, path, () if whole or of_server else tuple(installed)))
    if of_server:
        # Imported late, because only calls with a server need it.
        from drivecomm.cli.stop.served_lines import merged

        lines = merged(lines, of_server)
    if not lines:
        raise UsageError(f"{path}: there is no drive in this plant, so there is nothing to stop")
    return stop_lines(lines, line, how, spite, whole=whole or bool(of_server))


def stop_protocol(line: LineArguments, path: Path, protocol: str, model: str | None, how: Stop) -> int:
    """Stop the drives of a protocol in a plant, on all its lines, as `stop_all` does; return the exit code.

    If the plant has no drive of the protocol, each line gets a broadcast, which no drive confirms. Raises UsageError
    for a plant without lines.
    """
    if protocol not in installed:
        raise unknown_protocol(protocol, installed)
    spite = SafeLookups(as_json=line.json)
    try:
        plant, whole = _plant(path, spite)
    except Exception as error:
        served = [replace(each, drives=_of(protocol, each.drives)) for each in _of_server(line, path, spite)]
        there = [each for each in served if each.drives]
        if not there and line.port is None:
            raise
        code = stop_lines(there, line, how, spite, whole=True) if there else FileFormatError.exit_code
        if not there:
            stop_one(replace(line, plant=None, given=line.given | {"port"}), f"{protocol}:*", model, how)
        spite.note(error)
        return code
    chosen = {"model": model} if model else {}
    asked = plant.only(replace(each, options={**each.options, **chosen}) for each in _of(protocol, plant.drives))
    lines = list(_lines_of(asked, line, path, () if whole and asked.drives else (protocol,)))
    if not lines:
        raise UsageError(f"{path}: this plant has no line; give --port to stop all {protocol} drives on one")
    return stop_lines(lines, line, how, spite, whole=whole)


def _of(protocol: str, drives: Iterable[DriveConfig]) -> tuple[DriveConfig, ...]:
    return tuple(each for each in drives if each.protocol == protocol)


def _plant(path: Path, spite: SafeLookups) -> tuple[Plant, bool]:
    """Return the plant of a file, and whether it is complete. Raises FileFormatError if nothing can be read."""
    plant, wrong = readable_plant(path)
    for sentence in wrong:
        spite.note(sentence)
    return plant, not wrong


def _of_server(line: LineArguments, path: Path, spite: SafeLookups) -> list[StoppedLine]:
    """Return the lines of the server of a plant file; empty if no server is running or it does not respond."""
    server = spite.of(lambda: server_of_plant(path), None, "the server of this plant was not found")
    if server is None:
        return []
    # Imported late, because only calls with a server need it.
    from drivecomm.cli.stop.served_lines import lines_of_server

    try:
        return lines_of_server(server, line)
    except Exception as error:  # noqa: BLE001 - the file or the ports may still work
        spite.lost.add(server.pid)
        spite.note(f"{error}; trying the ports directly")
        return []


def _lines_of(plant: Plant, line: LineArguments, path: Path, also: tuple[str, ...]) -> Iterator[StoppedLine]:
    # Facts of the command line override those of the plant's lines and drives.
    said = line.said_facts
    for each in plant.lines:
        drives = plant.on_line(each.name)
        if drives or also:
            yield StoppedLine(
                name=each.name,
                port=each.reached_at or (line.port if len(plant.lines) == 1 else None),
                opening={**line.opening, **each.opening, **said},
                drives=tuple(replace(drive, options={**drive.options, **said}) for drive in drives),
                also=also,
                file=os.path.realpath(path),
                said=said,
            )
