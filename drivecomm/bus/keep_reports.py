"""Reports about a kept motor, in the same words for every keeper, and each event once."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.bus.watchdog import Setting
    from drivecomm.errors import DriveCommError
    from drivecomm.protocol import DriveStatus, LinkLoss, Value


class KeepReports:
    """Reporter of the events of a kept motor.

    on_news: called with a word for programs, a sentence for people, and further content. on_error: called when the
    drive begins to fail, not for each failed refresh. on_fault: called when the drive has a new fault.
    """

    def __init__(
        self,
        on_news: Callable[..., None],
        on_error: Callable[[DriveCommError], None],
        on_fault: Callable[[], None],
    ) -> None:
        self.tell, self._on_error, self._on_fault = on_news, on_error, on_fault
        self._failing: type[DriveCommError] | None = None
        self._is_in_fault = False
        self.fault = False
        """Whether the drive has had a fault so far."""

    def watchdog_set(self, setting: Setting | None) -> None:
        """Report the present setting of the drive's watchdog."""
        self.tell("watchdog set", f"watchdog: {setting} without this program")

    def started(self, what: str, policy: LinkLoss, watchdog_s: Value | float | str) -> None:
        """Report that the motor was started. what: description of the start."""
        text = f"{what}; Ctrl-C stops it and restores the watchdog"
        self.tell("started", text, link_loss=policy, watchdog_s=watchdog_s)

    def stopped(self) -> None:
        """Report that the motor was released: the stop is commanded, and the watchdog restored."""
        self.tell("stop commanded", "stop commanded; watchdog restored")

    def failed(self, error: DriveCommError) -> None:
        """Report that communication with the drive has failed."""
        if type(error) is not self._failing:
            self._failing = type(error)
            self._on_error(error)

    def answered(self, status: DriveStatus) -> None:
        """Report that the drive answers again, or has a fault."""
        if self._failing is not None:
            self._failing = None
            self.tell("answers again", "answers again")
        was_in_fault, self._is_in_fault = self._is_in_fault, status.fault
        if status.fault and not was_in_fault:
            self.fault = True
            fault = " ".join(str(part) for part in (status.fault_code, status.fault_text) if part)
            self.tell("fault", f"has a fault{f' ({fault})' if fault else ''}", fault_code=status.fault_code)
            self._on_fault()
