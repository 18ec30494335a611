"""Drives that a recording names, and the protocols in the order in which to look for them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.errors import UsageError
from drivecomm.protocol import installed, parse_drive

if TYPE_CHECKING:
    from collections.abc import Iterable

    from drivecomm.capture import Provenance
    from drivecomm.protocol import DriveConfig, Protocol


def recorded_with(provenance: Provenance) -> list[DriveConfig]:
    """Return the drives that a recording lists for its line, without those of protocols that are not installed.

    The header may come from anywhere, so entries that do not name a valid drive are skipped.
    """
    found = []
    for text in provenance.drives:
        try:
            drive = parse_drive(text)
        except UsageError:
            continue
        if drive.protocol in installed and drive.address in installed[drive.protocol].addresses:
            found.append(drive)
    return found


def protocols_for(drives: Iterable[DriveConfig]) -> list[Protocol]:
    """Return all protocols, those of these drives first.

    The sniffer looks only for the first of two protocols whose telegrams are the same.
    """
    names = [*(each.protocol for each in drives), *(each.name for each in installed.working())]
    return [installed[name] for name in dict.fromkeys(names)]
