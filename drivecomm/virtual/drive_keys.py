"""What can be said of a virtual drive in the same words everywhere: a plant file, a command line, a test."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from drivecomm.errors import UsageError, shortened
from drivecomm.protocol import DriveConfig, installed, is_duration, option_names
from drivecomm.virtual.drives import drive_type
from drivecomm.virtual.planted_drive import PlantedDrive

if TYPE_CHECKING:
    from pathlib import Path

    from drivecomm.protocol import Model, VirtualDrive

_KEYS = ("needs_pause_s", "reply_delay_s", "values", "motor")


def planted(drive: DriveConfig, *, line: str) -> DriveConfig:
    """Return a drive for a line of a plant, with those of its options that are keys of a virtual drive as such.

    An option that its protocol has by the same name stays one. Raises UsageError.
    """
    own = option_names(installed[drive.protocol])
    keys: dict[str, Any] = {key: drive.options[key] for key in _KEYS if key in drive.options and key not in own}
    for key in ("needs_pause_s", "reply_delay_s"):
        if key in keys and not is_duration(keys[key]):
            raise UsageError(f"invalid {key} = {shortened(keys[key])}; write seconds, 0 or more")
    for key in ("values", "motor"):
        if key in keys and not isinstance(keys[key], Mapping):
            raise UsageError(f"invalid {key} = {shortened(keys[key])}; write a table such as {{'480': 2000}}")
    options = {name: value for name, value in drive.options.items() if name not in keys}
    return replace(drive, line=line, options=options, **keys)


def virtual_drive(
    protocol: str, address: int, *, model: str | Path | Model | None = None, **options: Any
) -> VirtualDrive:
    """Return a virtual drive that behaves as the protocol's manual says a real one does.

    model: its parameters and start values, the protocol's own default if absent. options: its line settings (baudrate,
    parity, ...), its gap_s, the protocol's drive options, and the keys of a virtual drive in a plant file:
    needs_pause_s, reply_delay_s, values, motor. Raises UsageError for anything that cannot be.
    """
    named = planted(DriveConfig(protocol=protocol, address=address, options=options), line="")
    kind = drive_type(protocol, address, model=model, options=named.options)
    return kind.new() if named.options == options else PlantedDrive(named, kind.model, for_all={})
