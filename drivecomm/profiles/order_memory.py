"""What a master remembers of a drive whose commands are registers, and how such a drive is stopped for sure."""

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
    """What is remembered of one drive, shared by all who speak to it on one bus.

    held: the step that commands the drive, None when there is none, or none that holds. runs: whether it lets the motor
    run. obeyed: whether a status has shown since that the drive does what it says. watched: whether the drive's
    watchdog is known to be on. unanswered: its last request had no answer, so that the next question may have to wait
    for a late one.
    """

    def __init__(self) -> None:
        self.held: Step | None = None
        self.runs = self.obeyed = self.watched = self.unanswered = False

    def hold(self, step: Step, *, runs: bool) -> None:
        """Take note of a step that commands the drive from now on."""
        self.held, self.runs, self.obeyed = step, runs, False

    def forget(self) -> None:
        """Forget what was commanded; it is not sent again."""
        self.held, self.runs, self.obeyed = None, False, False

    def watch(self, silence_s: float | None) -> None:
        """Take note whether the watchdog is on."""
        self.watched = silence_s is not None

    def notice(self, *, running: bool, fault: bool) -> None:
        """Take note of a status: what it contradicts after it was obeyed, or after a trip, holds no longer."""
        if fault and self.runs:
            self.forget()
        elif running is self.runs:
            self.obeyed = True
        elif self.obeyed:
            self.forget()


def stop_for_sure(
    how: Stop, commander: Commander, table: ControlTable, memory: OrderMemory, read: Callable[[str], Exchange[Reading]]
) -> Exchange[None]:
    """Stop one drive in a way that is asked for, or by `sure_stop` where those words might mean something else.

    What the drive obeys is read first, and once. If it obeys something else, refuses or does not answer, or if the
    request would have to wait for a late reply, the stop that starts nothing in any case goes out instead.
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
