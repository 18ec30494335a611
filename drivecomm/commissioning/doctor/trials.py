"""Trials with a drive that misses requests: more time for its reply, or a longer pause before a request."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.errors import DriveError, ReplyError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from drivecomm.bus import Drive

_TRIES = 8
"""Number of consecutive requests that must all be answered before an option counts as the remedy."""

PATIENCE_S = 3.0
"""Reply timeout in seconds that is longer than the reply time of any drive in the manuals."""

_PAUSES_S = (0.02, 0.05, 0.1, 0.2, 0.5)


def needed_options(build: Callable[..., Drive]) -> Mapping[str, float]:
    """Return the drive options with which a drive answers every request; empty if no tried option helps.

    build: returns the drive with additional options. The trials use a longer reply timeout, then longer and longer
    pauses between a reply and the next request. They send only probes, which move no motor.
    """
    timeout_s = _timeout_needed(build)
    if timeout_s:
        return {"reply_timeout_s": timeout_s}
    for pause_s in _PAUSES_S:
        drive = build(turnaround_s=pause_s)
        if pause_s > build().facts.turnaround_s and all(_answers(drive) for _ in range(_TRIES)):
            return {"turnaround_s": pause_s}
    return {}


def _timeout_needed(build: Callable[..., Drive]) -> float:
    """Return a reply timeout in seconds with which all requests are answered; 0 if a longer timeout does not help."""
    drive, usual_s = build(reply_timeout_s=PATIENCE_S), build().facts.timing.reply_timeout_s
    longest_s = 0.0
    for _ in range(_TRIES):
        began = drive.bus.now()
        if not _answers(drive):
            return 0.0
        longest_s = max(longest_s, drive.bus.now() - began)
    # If all replies were in time, slowness was not the cause of the missing ones.
    return round(2 * longest_s, 2) if longest_s > usual_s else 0.0


def _answers(drive: Drive) -> bool:
    try:
        drive.probe()
    except ReplyError:
        return False
    except DriveError:
        # A drive that refuses has answered.
        return True
    return True
