"""Identity of a drive, and the part of it that does not change on the same drive."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.bus import ask_identity
from drivecomm.errors import DriveError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.bus import Procedure

# Fields that may change on the same drive.
_PASSING = ("state", "software", "firmware", "version", "hours")


def read_identity() -> Procedure[Mapping[str, str]]:
    """Return the identity that a drive reports, without its state; empty if the drive refuses."""
    try:
        told: Mapping[str, str] = yield ask_identity()
    except DriveError:
        return {}
    return {key: text for key, text in told.items() if key != "state"}


def lasting_identity(identity: Mapping[str, str]) -> dict[str, str]:
    """Return the identity fields that stay the same on the same drive."""
    return {key: text for key, text in identity.items() if not any(word in key.lower() for word in _PASSING)}
