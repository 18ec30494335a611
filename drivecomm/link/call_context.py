"""One call of a caller as the link sees it: its deadline, and the events that end it earlier."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivecomm.errors import CommandCancelledError, CommandTooOldError, DeadlineError, OvertakenError
from drivecomm.link.port import LinkSteps, Wait

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.errors import ReplyError
    from drivecomm.link.command_order import CommandCall
    from drivecomm.link.line_state import LineState
    from drivecomm.link.peer import DriveRecord, Peer
    from drivecomm.protocol import Ask


@dataclass(slots=True)
class CallContext:
    """One call as the link carries it out.

    peer: the drive. record: what the link knows of this drive. paced: whether characters take their real time on this
    port. stop_waits: returns whether a stop waits for the line. deadline: end of the call's time. gives_way: whether a
    stop overtakes this call. command: the command of this call; None if no stop can cancel the call.
    yields_to_others: called after a failed attempt; returns whether to end the attempts because others wait.
    listen_until: time when a probe stops listening; None for the whole reply time. failed: error of the last request
    that was given up. told: whether a telegram without a reply was sent. may_be_held_back: whether nothing was sent
    yet, so that others may use the line first.
    """

    line: LineState
    peer: Peer
    record: DriveRecord
    paced: bool
    stop_waits: Callable[[], bool]
    deadline: float
    gives_way: bool
    command: CommandCall | None
    yields_to_others: Callable[[], bool]
    listen_until: float | None = None
    failed: ReplyError | None = None
    told: bool = False
    may_be_held_back: bool = False

    def stay(self, until: float) -> LinkSteps[None]:
        """Wait until this time, at most until the call's deadline.

        Raises OvertakenError if a stop waits for the line, and DeadlineError at the deadline.
        """
        line, until = self.line, min(until, self.deadline)
        while line.now < until:
            self.check_overtaken()
            line.now = (yield Wait(until, self.gives_way)).time
        self.check_deadline()

    def check_others(self) -> None:
        """Raise the last error if only the confirmation of a stop is missing and others wait for the line."""
        if self.failed is not None and self.told and self.yields_to_others():
            raise self.failed

    def check_deadline(self) -> None:
        """Raise DeadlineError if the call's time has run out."""
        if self.line.now >= self.deadline:
            raise DeadlineError(
                f"{self.peer.name}: the call's deadline ({self.peer.facts.timing.deadline_s:g} s) has expired"
            )

    def check_overtaken(self) -> None:
        """Raise OvertakenError if a stop waits for the line and this call gives way to it."""
        if self.gives_way and self.stop_waits():
            raise OvertakenError(f"{self.peer.name} was not asked, because a stop went first")

    def check_command(self, *, acts: bool) -> None:
        """Raise CommandCancelledError if a stop was called after the command; then run the command's own check.

        acts: whether the next telegram makes the drive do something.
        """
        if self.command is not None and self.command.cancelled:
            raise CommandCancelledError(
                f"{self.peer.name} was not sent the command, because a stop was called after it; start it again if it "
                "should run"
            )
        if self.command is not None:
            self.command.check(acts=acts)

    def check_age(self, ask: Ask) -> None:
        """Raise CommandTooOldError if a repeated command is older than the drive's watchdog time.

        The watchdog may have acted by then, so the command may no longer hold.
        """
        silent_s = self.line.now - self.record.commanded_at
        if ask.command == "repeated" and silent_s > self.record.watchdog_s:
            self.line.away(self.peer.name)
            raise CommandTooOldError(
                f"{self.peer.name} was last commanded {silent_s:.1f} s ago, longer than its watchdog waits; what it "
                "was commanded is not repeated, so start it again if it should run"
            )
