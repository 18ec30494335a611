"""Drives and broadcasts on a line of any kind, for blocking and asynchronous callers."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.bus.call_styles import AwaitedCalls, BlockingCalls
from drivecomm.bus.procedures import carry_out, carry_out_async, reaching
from drivecomm.bus.verbs import BroadcastVerbs, DriveVerbs

if TYPE_CHECKING:
    from drivecomm.bus.line_interface import AwaitedLine, BlockingLine  # noqa: F401 - used as strings in the bases of the classes
    from drivecomm.bus.procedures import Goal
    from drivecomm.protocol import DriveStatus


class Drive(DriveVerbs["BlockingLine"], BlockingCalls):
    """One addressed drive, made by `Bus.drive`: the one interface to drives of every maker.

    Every verb is one exchange on the bus. It may raise LinkError (port or line), ReplyError (no believable reply),
    DriveError (the drive refused), and UsageError before anything is sent. A drive that does not answer is given up
    after some time: its verbs then raise NotAnsweringError immediately, and only now and then send a request again;
    `stop` and `probe` always send theirs.

    A stop goes before everything else: a call that waits for a reply meanwhile raises OvertakenError, and commands for
    the same drive that were called before the stop and are not carried out yet raise CommandCancelledError.
    """

    def wait_for(self, goal: Goal, timeout_s: float = 10.0) -> DriveStatus:
        """Poll the status until the drive is in a state, or "at_reference"; return that status.

        Others may use the line meanwhile. Raises StateError if the drive does not reach the state in time, and
        immediately if it has a fault, unless a fault is the goal.
        """
        return carry_out(self, reaching(self.name, goal, timeout_s, self.bus.now))


class Broadcast(BroadcastVerbs["BlockingLine"], BlockingCalls):
    """All drives of one protocol on a bus at once. They never answer, so their reactions are unknown."""


class AsyncDrive(DriveVerbs["AwaitedLine"], AwaitedCalls):
    """One addressed drive, made by `AsyncBus.drive`; every verb is one exchange on the bus, with the errors of `Drive`.

    Cancelling a verb leaves the bus usable; whether the drive acted on a cancelled command is unknown.
    """

    async def wait_for(self, goal: Goal, timeout_s: float = 10.0) -> DriveStatus:
        """Poll the status until the drive is in a state, or "at_reference", as `Drive.wait_for` does."""
        return await carry_out_async(self, reaching(self.name, goal, timeout_s, self.bus.now))


class AsyncBroadcast(BroadcastVerbs["AwaitedLine"], AwaitedCalls):
    """All drives of one protocol on a bus at once. They never answer, so their reactions are unknown."""
