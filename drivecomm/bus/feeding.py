"""Procedures that keep a motor while its keeper lives: by the drive's own watchdog, or by the lease of a server."""

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
    """Procedures that keep one motor. silence_s: seconds without a refresh after which its policy takes effect."""

    silence_s: float
    setting: Setting | None
    """Setting of the drive's watchdog meanwhile; None if its model does not know it."""

    def taking(self) -> Procedure[None]:
        """Begin to keep the motor, without starting it.

        Raises an error if the motor cannot be kept, and then leaves nothing changed.
        """

    def refreshing(self) -> Procedure[DriveStatus]:
        """Refresh the watchdog or the lease, and return the drive's status."""

    def stopping(self, how: Stop | None) -> Procedure[None]:
        """Stop the motor once; do nothing if `how` is None."""

    def restoring(self) -> Procedure[None]:
        """End the keeping and restore the watchdog, so that a program that polls less often does not trigger it."""


class WatchdogFeeding:
    """Keeping by the drive's own watchdog, set to a policy and fed by status reads; for "hold" it must be off."""

    def __init__(self, drive: DriveVerbs[Any], policy: LinkLoss, watchdog_s: Value) -> None:
        self.silence_s = float(watchdog_s)
        self.setting: Setting | None = None
        self._drive, self._policy, self._watchdog_s = drive, policy, watchdog_s
        self._earlier: Setting | None = None

    def taking(self) -> Procedure[None]:
        """Set the watchdog to the policy, and remember its earlier setting."""
        name, model = self._drive.name, self._drive.model
        if self._policy != "hold":
            # Created first, because it rejects an invalid setting before anything is sent.
            setting = setting_watchdog(name, model, self._policy, self._watchdog_s)
            self._earlier = yield from reading_watchdog(name, model)
            status: DriveStatus = yield ask_status()
            if not status.running and not status.fault:
                # Only restarts the watchdog time, which may have nearly expired since the last command.
                yield stop_motor(Stop.RAMP)
            self.setting = yield from setting
        elif policies(model):
            self.setting = yield from reading_watchdog(name, model)
            if self.setting.policy != "hold":
                raise StateError(
                    f"the watchdog of {name} is on ({self.setting}), which differs from hold; choose its policy, or "
                    "switch it off first"
                )

    def refreshing(self) -> Procedure[DriveStatus]:
        """Read the status with the rank of a command, so that reads of others cannot delay it for too long."""
        status: DriveStatus = yield ask_status_first()
        return status

    def stopping(self, how: Stop | None) -> Procedure[None]:
        """Stop the motor once; do nothing if `how` is None."""
        if how is not None:
            yield stop_motor(how)

    def restoring(self) -> Procedure[None]:
        """Restore the earlier setting of the watchdog."""
        if self._earlier is not None:
            yield from restoring_watchdog(self._drive.name, self._drive.model, self._earlier)
