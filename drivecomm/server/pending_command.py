"""Last checks of a queued command before it is sent: a stop or the end of its lease may have come meanwhile."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivecomm.errors import CommandCancelledError, LeaseError, UsageError

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.link import CommandCall
    from drivecomm.protocol import DriveConfig, LineFacts
    from drivecomm.server.core import Core
    from drivecomm.server.leases import Lease


_KEEPING = 12
"""Number of telegrams that set a drive's watchdog and read it back before a kept motor is started."""

_CHARACTERS, _TURNAROUND_S = 50, 0.1
"""Length and turnaround of one of these telegrams with its reply, at most, for nearly all drives."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PendingCommand:
    """A command that waits in the server.

    found: returns the current plant data of its drive; config: these data when the command was accepted. fresh: raises
    if the command is too old. came_s: time of arrival on the clock of `time.monotonic`. own_s: duration of the
    telegrams that prepare the command; it does not count as waiting. starts: whether the command may start the motor.
    """

    core: Core
    lease: Lease
    found: Callable[[], DriveConfig]
    config: DriveConfig
    call: CommandCall
    fresh: Callable[..., None]
    came_s: float
    own_s: float = 0.0
    starts: bool = False

    def check_all(self) -> None:
        """Raise if the command must no longer be sent; nothing is awaited between this check and the telegram."""
        self.check_fresh()
        self.check()

    def check(self) -> None:
        """Raise if the command must no longer be sent, whatever its age."""
        core, name = self.core, self.lease.drive
        if core.ending:
            raise UsageError("the server ends; only stops are still sent")
        if self.call.cancelled:
            raise CommandCancelledError(f"a stop of {name} was requested after this command, which was not sent")
        if self.starts:
            core.stop_demands.check(name)
        if name in core.changing:
            raise UsageError(f"{name} is being replaced, because the plant file is read again; try again")
        if self.found() != self.config:
            raise UsageError(f"{name} was replaced, because the plant file was read again; try again")
        held = core.leases.holder_of(name, now=time.monotonic())
        if held is None or held.key != self.lease.key:
            raise LeaseError(f"the lease of {name} has expired; acquire it again")

    def check_fresh(self) -> None:
        """Raise NotAllowedError if the command has waited too long."""
        here_s = time.monotonic() - self.came_s
        own_s = min(self.own_s, here_s)
        self.fresh(time_s=time.time() - own_s, waited_s=here_s - own_s)


def keeping_takes_s(facts: LineFacts) -> float:
    """Return the seconds that it takes to prepare a kept motor for its start, on an otherwise idle line."""
    return _KEEPING * (facts.settings.wire_s(_CHARACTERS) + _TURNAROUND_S)
