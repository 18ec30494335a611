"""Whether a command that was let through is still to be sent: a stop or the end of its lease may have come since."""

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
"""So many telegrams set a drive's watchdog and read it back, before a motor that is kept is started."""

_CHARACTERS, _TURNAROUND_S = 50, 0.1
"""Of one of them and its reply, at most for nearly all drives."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Wanted:
    """A command that waits in the server.

    found: returns what the plant says of its drive now; config: what it said when the command was let through. fresh:
    raises for one that is too old. came_s: by `time.monotonic`. own_s: what its own telegrams take before the one that
    counts, which is no waiting. starts: whether it may start the motor.
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
        """Raise when it must not be sent any more; nothing is awaited between this and the telegram."""
        self.check_fresh()
        self.check()

    def check(self) -> None:
        """Raise when it must not be sent any more, however young it is."""
        core, name = self.core, self.lease.drive
        if core.ending:
            raise UsageError("the server ends; nothing is commanded through it any more but a stop")
        if self.call.cancelled:
            raise CommandCancelledError(f"{name} was to be stopped after this command was given, which was not sent")
        if self.starts:
            core.stop_demands.check(name)
        if name in core.changing:
            raise UsageError(f"{name} changes, because the plant file is read again; try again")
        if self.found() != self.config:
            raise UsageError(f"{name} has changed, because the plant file was read again; try again")
        held = core.leases.holder_of(name, now=time.monotonic())
        if held is None or held.key != self.lease.key:
            raise LeaseError(f"the lease of {name} is over; take it again")

    def check_fresh(self) -> None:
        """Raise NotAllowedError when it has waited for too long."""
        here_s = time.monotonic() - self.came_s
        own_s = min(self.own_s, here_s)
        self.fresh(time_s=time.time() - own_s, waited_s=here_s - own_s)


def keeping_takes_s(facts: LineFacts) -> float:
    """Return how long it takes to prepare a motor that is kept for its start, on a line that nobody else uses."""
    return _KEEPING * (facts.settings.wire_s(_CHARACTERS) + _TURNAROUND_S)
