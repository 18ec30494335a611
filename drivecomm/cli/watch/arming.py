"""Whether a drive may be commanded from the screen, and if not, why not."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from drivecomm.protocol import DriveConfig

HOLD: Literal["hold"] = "hold"
"""The policy for which nobody has to stay: the motor goes on."""


def why_not(verb: Literal["start", "reset"], drive: DriveConfig, *, armed: bool) -> str:
    """Return why this drive is not to be started or reset, empty when it may. armed: --arm was given."""
    if not armed:
        return f"{drive.name} is not commanded: watch was started without --arm"
    if not drive.armed:
        return f"{drive.name} is read-only: write armed = true for it in the plant file"
    if verb == "start" and drive.link_loss is None:
        return f"{drive.name} is not started: the plant file does not say its link_loss, what it does without a master"
    if verb == "start" and drive.link_loss is not None and drive.link_loss.policy != HOLD:
        # Another policy needs somebody who sets the drive's watchdog and stays; a screen may be closed at any moment.
        way = f"drivecomm start {drive.name} --link-loss {drive.link_loss.policy}"
        return f"{drive.name} is not started from here: use {way}, which stays with it"
    return ""
