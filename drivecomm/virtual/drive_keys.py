"""Keys of a virtual drive that mean the same in a plant file, on a command line and in a test."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from drivecomm.errors import UsageError, shortened
from drivecomm.protocol import DriveConfig, installed, is_duration, option_names
from drivecomm.virtual.drives import drive_type
from drivecomm.virtual.plant_drive import PlantDrive

if TYPE_CHECKING:
    from pathlib import Path

    from drivecomm.protocol import Model, VirtualDrive

_KEYS = ("needs_pause_s", "reply_delay_s", "values", "motor")


def separate_drive_keys(drive: DriveConfig, *, line: str) -> DriveConfig:
    """Return a drive for a line of a plant, with the general keys of a virtual drive separated from its options.

    A key that the protocol has as an option of the same name remains an option. Raises UsageError for an invalid value.
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
    """Return a virtual drive that behaves as the protocol's manual describes a real one.

    model: source of its parameters and start values; None for the protocol's default model. options: its line settings
    (baudrate, parity, ...), its gap_s, the protocol's drive options, and the keys of a virtual drive in a plant file:
    needs_pause_s, reply_delay_s, values, motor. Raises UsageError for invalid arguments.
    """
    named = separate_drive_keys(DriveConfig(protocol=protocol, address=address, options=options), line="")
    kind = drive_type(protocol, address, model=model, options=named.options)
    return kind.new() if named.options == options else PlantDrive(named, kind.model, for_all={})
