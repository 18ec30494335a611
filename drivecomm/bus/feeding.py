"""What keeps a motor while its keeper lives, as procedures: the drive's own watchdog, or the lease of a server."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

from drivecomm.bus.procedures import ask_status, ask_status_first, stop_motor
from drivecomm.bus.watchdog import policies, reading_watchdog, restoring_watchdog, setting_watchdog
from drivecomm.errors import StateError
from drivecomm.protocol import Stop

if TYPE_CHECKING:
    from drivecomm.bus.procedures import Procedure
    from drivecomm.bus.verbs import DriveVerbs
    from drivecomm.bus.watchdog import Setting
    from drivecomm.protocol import DriveStatus, LinkLoss, Value


class Feeding(Protocol):
    """How one motor is kept. silence_s: the motor is treated by its policy after this time without a refresh."""

    silence_s: float
    setting: Setting | None
    """How the drive's watchdog is set meanwhile; None if its model does not know it."""

    def taking(self) -> Procedure[None]:
        """Begin; nothing is started. Raises what keeps the motor from being kept, before anything is left changed."""

    def refreshing(self) -> Procedure[DriveStatus]:
        """Say that the keeper lives, and return the drive's status."""

    def stopping(self, how: Stop | None) -> Procedure[None]:
        """Stop the motor once; do nothing for None."""

    def restoring(self) -> Procedure[None]:
        """End, and set the watchdog as it was, so that a program that speaks less often does not set it off."""


class WatchdogFeeding:
    """Sets the drive's own watchdog to a policy and feeds it, by reading the status; with "hold" it must be off."""

    def __init__(self, drive: DriveVerbs[Any], policy: LinkLoss, watchdog_s: Value) -> None:
        self.silence_s = float(watchdog_s)
        self.setting: Setting | None = None
        self._drive, self._policy, self._watchdog_s = drive, policy, watchdog_s
        self._earlier: Setting | None = None

    def taking(self) -> Procedure[None]:
        """Set the watchdog to the policy, and remember how it was."""
        name, model = self._drive.name, self._drive.model
        if self._policy != "hold":
            # Made first, because it refuses what cannot be before anything is sent.
            setting = setting_watchdog(name, model, self._policy, self._watchdog_s)
            self._earlier = yield from reading_watchdog(name, model)
            status: DriveStatus = yield ask_status()
            if not status.running and not status.fault:
                # Changes nothing, but a drive that counts from its last command would act at once if that is long ago.
                yield stop_motor(Stop.RAMP)
            self.setting = yield from setting
        elif policies(model):
            self.setting = yield from reading_watchdog(name, model)
            if self.setting.policy != "hold":
                raise StateError(
                    f"the watchdog of {name} is on ({self.setting}), which is not hold; choose its policy, or "
                    "switch it off first"
                )

    def refreshing(self) -> Procedure[DriveStatus]:
        """Read the status; however much is read by others, the drive is spoken to in time."""
        status: DriveStatus = yield ask_status_first()
        return status

    def stopping(self, how: Stop | None) -> Procedure[None]:
        """Stop the motor once."""
        if how is not None:
            yield stop_motor(how)

    def restoring(self) -> Procedure[None]:
        """Set the watchdog as it was."""
        if self._earlier is not None:
            yield from restoring_watchdog(self._drive.name, self._drive.model, self._earlier)
