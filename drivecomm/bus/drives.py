"""Drives, and all drives of a protocol at once, on a line of any kind: blocking and awaited."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.bus.faces import Awaited, Blocking
from drivecomm.bus.procedures import carry_out, carry_out_async, reaching
from drivecomm.bus.verbs import BroadcastVerbs, DriveVerbs

if TYPE_CHECKING:
    from drivecomm.bus.line_face import AwaitedLine, BlockingLine  # noqa: F401 - named in the bases of the classes
    from drivecomm.bus.procedures import Goal
    from drivecomm.protocol import DriveStatus


class Drive(DriveVerbs["BlockingLine"], Blocking):
    """One addressed drive, made by `Bus.drive`: the one interface to drives of every maker.

    Every verb is one exchange on the bus. It may raise LinkError (port or line), ReplyError (no believable reply),
    DriveError (the drive said no), and UsageError before anything is sent. A drive that does not answer is given up
    after some time: its verbs then raise NotAnsweringError at once, and now and then ask again; only `stop` and `probe`
    always ask.

    A stop goes before everything: what waits for a reply meanwhile raises OvertakenError, and commands for the same
    drive that were called before it and are not carried out yet raise CommandCancelledError.
    """

    def wait_for(self, goal: Goal, timeout_s: float = 10.0) -> DriveStatus:
        """Ask for the status until the drive is in a state, or "at_reference"; returns that status.

        Others use the line meanwhile. Raises StateError if the drive does not reach the state in time, and at once when
        it has a fault that is not waited for.
        """
        return carry_out(self, reaching(self.name, goal, timeout_s, self.bus.now))


class Broadcast(BroadcastVerbs["BlockingLine"], Blocking):
    """All drives of one protocol on a bus at once. Nobody answers, so nothing is known of what they did."""


class AsyncDrive(DriveVerbs["AwaitedLine"], Awaited):
    """One addressed drive, made by `AsyncBus.drive`; every verb is one exchange on the bus, and raises as `Drive`'s do.

    Cancelling a verb leaves the bus usable; whether the drive acted on a command that was cancelled is not known.
    """

    async def wait_for(self, goal: Goal, timeout_s: float = 10.0) -> DriveStatus:
        """Ask for the status until the drive is in a state, or "at_reference"; as `Drive.wait_for`."""
        return await carry_out_async(self, reaching(self.name, goal, timeout_s, self.bus.now))


class AsyncBroadcast(BroadcastVerbs["AwaitedLine"], Awaited):
    """All drives of one protocol on a bus at once. Nobody answers, so nothing is known of what they did."""
