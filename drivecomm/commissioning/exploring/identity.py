"""What a drive tells of itself, and what of it stays while it is the same drive."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.bus import ask_identity
from drivecomm.errors import DriveError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.bus import Procedure

# What may change while it stays the same drive.
_PASSING = ("state", "software", "firmware", "version", "hours")


def identity_told() -> Procedure[Mapping[str, str]]:
    """Return what the drive tells of itself, nothing where it refuses; its state says nothing of what it is."""
    try:
        told: Mapping[str, str] = yield ask_identity()
    except DriveError:
        return {}
    return {key: text for key, text in told.items() if key != "state"}


def lasting(identity: Mapping[str, str]) -> dict[str, str]:
    """Return what of a drive's identity stays as it is while it stays the same drive."""
    return {key: text for key, text in identity.items() if not any(word in key.lower() for word in _PASSING)}
