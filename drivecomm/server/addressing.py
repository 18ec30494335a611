"""Lookup of the line and the drive that a command names."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from drivecomm.client import drive_options
from drivecomm.errors import UsageError
from drivecomm.line import in_own_thread
from drivecomm.protocol import parse_drive

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivecomm.protocol import DriveConfig
    from drivecomm.server.core import Core
    from drivecomm.server.door import CommandRequest
    from drivecomm.server.served_line import ServedLine

_ALL = "*"
"""The address of all drives of a protocol."""


def find_target(core: Core, command: CommandRequest) -> tuple[ServedLine, DriveConfig]:
    """Return the line and the drive that a command names. Raises UsageError if the plant has no such line or drive."""
    if not command.line:
        config = core.plant.drive(command.drive)
        line = core.line(config.line)
    else:
        line = core.line(command.line)
        config = _on(line, command.drive)
    return line, config.with_options(**drive_options(command.options)) if command.options else config


async def find_stop_target(core: Core, command: CommandRequest) -> tuple[ServedLine, DriveConfig]:
    """Return the line and the drive that a stop names, as `find_target` does.

    While the plant file is read again, waits for the new plant before raising UsageError for an unknown name.
    """
    try:
        return find_target(core, command)
    except UsageError:
        if not core.changing:
            raise
    await core.settled()
    return find_target(core, command)


async def open_drive(core: Core, line: ServedLine, config: DriveConfig, *, arm: bool) -> Any:
    """Wait until the line is open, then return the drive, or the broadcast, that has the verbs as methods.

    Building a new drive reads its model file, in a thread.
    """
    await line.opened()
    if config.address < 0:
        return await in_own_thread(line.bus.broadcast, config.protocol, **config.options)
    known = next((each for each in line.drives if each.name == config.name), config)
    if not arm and replace(config, read_only_reason=known.read_only_reason) in line.drives:
        return line.drive(config.name)
    reason = "" if arm else config.why_read_only(core.plant.file)
    return await in_own_thread(replace(config, read_only_reason=reason).build, line.bus.drive)


def on_bus(config: DriveConfig) -> str:
    """Return the name of a drive on its bus: PROTOCOL:ADDRESS, or PROTOCOL:* for all drives of a protocol."""
    return str(config) if config.address >= 0 else f"{config.protocol}:{_ALL}"


def covered_drives(line: ServedLine, config: DriveConfig) -> Sequence[str]:
    """Return the plant names of the drives that a config covers: one drive, or all drives of its protocol."""
    return [
        each.name
        for each in line.drives
        if each.protocol == config.protocol and (config.address < 0 or each.name == config.name)
    ]


def _on(line: ServedLine, text: str) -> DriveConfig:
    """Return the drive PROTOCOL:ADDRESS of a line, with the plant's options if known; PROTOCOL:* means all drives."""
    protocol, _, address = text.partition(":")
    if address == _ALL:
        return replace(parse_drive(f"{protocol}:0"), name=text, address=-1, line=line.line.name)
    if (named := next((each for each in line.drives if each.name == text), None)) is not None:
        return named
    meant_by_it = replace(parse_drive(text), line=line.line.name)
    known = next((each for each in line.drives if str(each) == str(meant_by_it)), None)
    return meant_by_it if known is None else known.with_options(**meant_by_it.options)
