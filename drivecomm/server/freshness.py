"""Checks that a command is recent and meant for this run of the server.

Two clocks are used, because neither is reliable alone. The time before a command arrived is measured by the wall clocks
of both sides, and the time that it waited here by a monotonic clock. A stop is never too old.
"""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING

from drivecomm.errors import NotAllowedError, UsageError, shortened
from drivecomm.protocol import is_duration

if TYPE_CHECKING:
    from drivecomm.server.door import CommandRequest

LONGEST_VALID_S = 10.0
"""The longest validity that a command may have, in seconds."""


def check_fresh(command: CommandRequest, *, session: str, time_s: float, waited_s: float = 0.0) -> None:
    """Raise NotAllowedError for a command that is too old or meant for another run, UsageError for invalid times.

    session: session of this run. time_s: now, in seconds since 1970. waited_s: seconds that the command has waited in
    this server.
    """
    if command.verb == "stop":
        return
    valid_s, issued_s = command.valid_s, command.issued_s
    if not is_duration(valid_s) or not 0 < valid_s <= LONGEST_VALID_S:
        raise UsageError(f"invalid valid_s {shortened(valid_s)}; give seconds above 0, at most {LONGEST_VALID_S:g}")
    if issued_s is not None and not (isinstance(issued_s, int | float) and isfinite(issued_s)):
        raise UsageError(f"invalid issued_s {shortened(issued_s)}; give seconds since 1970")
    if command.session and command.session != session:
        raise NotAllowedError("the command was meant for an earlier run of the server; read its session again")
    if waited_s > valid_s:
        raise NotAllowedError(
            f"the command had to wait for {waited_s:.1f} s and is valid for only {valid_s:g} s; it was not sent"
        )
    if issued_s is None:
        return
    age_s = time_s - issued_s
    if age_s > valid_s:
        raise NotAllowedError(
            f"the command was given {age_s:.1f} s ago and is valid for only {valid_s:g} s; it was not sent (are both "
            "clocks right?)"
        )
    if -age_s > valid_s:
        raise NotAllowedError(
            f"the command is dated in the future by {-age_s:.1f} s; set the clock of its sender, or of the server"
        )
