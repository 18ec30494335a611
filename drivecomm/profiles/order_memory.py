"""State that a master keeps about a drive whose commands are registers, and the sure stop of such a drive."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.errors import RefusedError, ReplyError, StateError
from drivecomm.profiles.commander import check_needs
from drivecomm.protocol import Stop, asked_once

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.profiles.commander import Commander
    from drivecomm.profiles.control_table import ControlTable
    from drivecomm.profiles.profile import Step
    from drivecomm.protocol import Exchange, Reading


class OrderMemory:
    """State of one drive, shared by all its users on one bus.

    held: the step in force that commands the drive, None if there is none. runs: whether that step lets the motor run.
    obeyed: whether a status has shown since then that the drive obeys. watched: whether the drive's watchdog is known
    to be on. unanswered: whether the last request got no reply, so that the next request may have to wait for a late
    one.
    """

    def __init__(self) -> None:
        self.held: Step | None = None
        self.runs = self.obeyed = self.watched = self.unanswered = False

    def hold(self, step: Step, *, runs: bool) -> None:
        """Set the step that commands the drive from now on."""
        self.held, self.runs, self.obeyed = step, runs, False

    def forget(self) -> None:
        """Forget the last command, so that it is not sent again."""
        self.held, self.runs, self.obeyed = None, False, False

    def watch(self, silence_s: float | None) -> None:
        """Record whether the watchdog is on."""
        self.watched = silence_s is not None

    def notice(self, *, running: bool, fault: bool) -> None:
        """Process a status, which may end the command in force.

        A trip ends a start. A command also ends if a status contradicts it after an earlier status has confirmed it.
        """
        if fault and self.runs:
            self.forget()
        elif running is self.runs:
            self.obeyed = True
        elif self.obeyed:
            self.forget()


def stop_for_sure(
    how: Stop, commander: Commander, table: ControlTable, memory: OrderMemory, read: Callable[[str], Exchange[Reading]]
) -> Exchange[None]:
    """Stop one drive in the requested way, or by `sure_stop` if the drive might take those words for something else.

    The parameters that decide how the drive understands the words are read first, and once. If they hold other values,
    if the drive refuses or does not answer, or if the request would have to wait for a late reply, the stop that starts
    nothing in any case is sent instead.
    """
    if table.sure_stop and how in table.profile.stops and how.value != table.sure_stop:
        try:
            if memory.unanswered:
                how = Stop(table.sure_stop)
            else:
                yield from asked_once(check_needs(table.needs, read))
        except (StateError, RefusedError, ReplyError):
            how = Stop(table.sure_stop)
    yield from commander.stop(how)
