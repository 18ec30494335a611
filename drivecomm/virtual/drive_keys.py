"""What can be said of a virtual drive in the same words everywhere: a plant file, a command line, a test."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from drivecomm.errors import UsageError, shortened
from drivecomm.protocol import installed, is_duration, option_names

if TYPE_CHECKING:
    from drivecomm.protocol import DriveConfig

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
    options = {name: value for name, value in drive.options.items() if name not in keys}
    return replace(drive, line=line, options=options, **keys)
