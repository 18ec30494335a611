"""Whether a command that was let through is still to be sent: a stop or the end of its lease may have come since."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivecomm.errors import CommandCancelledError, LeaseError, UsageError

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.link import CommandCall
    from drivecomm.server.core import Core
    from drivecomm.server.leases import Lease


@dataclass(frozen=True, slots=True)
class Wanted:
    """A command that waits in the server. fresh: raises for one that is too old. came_s: by `time.monotonic`."""

    core: Core
    lease: Lease
    call: CommandCall
    fresh: Callable[..., None]
    came_s: float

    def check(self) -> None:
        """Raise when it must not be sent any more; nothing is awaited between this and the telegram."""
        core, name = self.core, self.lease.drive
        if core.ending:
            raise UsageError("the server ends; nothing is commanded through it any more but a stop")
        if self.call.cancelled:
            raise CommandCancelledError(f"{name} was to be stopped after this command was given, which was not sent")
        if name in core.changing:
            raise UsageError(f"{name} changes, because the plant file is read again; try again")
        held = core.leases.holder_of(name, now=time.monotonic())
        if held is None or held.key != self.lease.key:
            raise LeaseError(f"the lease of {name} is over; take it again")

    def check_fresh(self) -> None:
        """Raise NotAllowedError when it has waited for too long."""
        self.fresh(time_s=time.time(), waited_s=time.monotonic() - self.came_s)
