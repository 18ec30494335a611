"""What a master remembers of a drive whose commands are registers, and how such a drive is stopped for sure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.errors import RefusedError, ReplyError, StateError
from drivecomm.profiles.commander import check_needs
from drivecomm.protocol import Stop

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.profiles.commander import Commander
    from drivecomm.profiles.control_table import ControlTable
    from drivecomm.protocol import Exchange, Reading


class OrderMemory:
    """What is remembered of one drive, shared by all who speak to it on one bus.

    unanswered: its last request had no answer, so that the next question may have to wait for a late one.
    """

    def __init__(self) -> None:
        self.unanswered = False

    def forget(self) -> None:
        """Do nothing: no command is remembered."""

    def watch(self, silence_s: float | None) -> None:
        """Do nothing: whatever is sent to a drive feeds its watchdog."""


def stop_for_sure(
    how: Stop, commander: Commander, table: ControlTable, memory: OrderMemory, read: Callable[[str], Exchange[Reading]]
) -> Exchange[None]:
    """Stop one drive in a way that is asked for, or by `sure_stop` where those words might mean something else.

    What the drive obeys is read first. Where it obeys something else, refuses or is silent, and where the question
    would have to wait for a late reply, the stop that starts nothing in any case goes out instead.
    """
    if table.sure_stop and how in table.profile.stops and how.value != table.sure_stop:
        try:
            if memory.unanswered:
                how = Stop(table.sure_stop)
            else:
                yield from check_needs(table.needs, read)
        except (StateError, RefusedError, ReplyError):
            how = Stop(table.sure_stop)
    yield from commander.stop(how)
