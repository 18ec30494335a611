"""One call of a caller as the link carries it out: until when, and what may end it before."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivecomm.errors import CommandCancelledError, CommandTooOldError, DeadlineError, OvertakenError
from drivecomm.link.port import Steps, Wait

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.errors import ReplyError
    from drivecomm.link.command_order import CommandCall
    from drivecomm.link.line_state import LineState
    from drivecomm.link.peer import Peer, PeerState
    from drivecomm.protocol import Ask


@dataclass(slots=True)
class Call:
    """One call. peer: the drive; partner: what is remembered of it.

    paced: whether characters take their time on this port. stop_waits: tells whether a stop waits for the line.
    deadline: when the call's time is over. gives_way: whether this call is overtaken by a stop. command: whose command
    it is, None where it is none that a stop cancels. others_first: asked when an attempt has failed; tells whether to
    ask no more, because others wait for the line. listen_until: when a probe listens no longer, None for the whole
    reply time. failed: the error of the last request that was given up. told: whether a telegram without a reply has
    gone out. may_be_held_back: whether nothing has been sent yet, so that others may have the line first.
    """

    line: LineState
    peer: Peer
    partner: PeerState
    paced: bool
    stop_waits: Callable[[], bool]
    deadline: float
    gives_way: bool
    command: CommandCall | None
    others_first: Callable[[], bool]
    listen_until: float | None = None
    failed: ReplyError | None = None
    told: bool = False
    may_be_held_back: bool = False

    def stay(self, until: float) -> Steps[None]:
        """Let time pass, unless a stop waits for the line, at most until the call's time is over."""
        line, until = self.line, min(until, self.deadline)
        while line.now < until:
            self.check_overtaken()
            line.now = (yield Wait(until, self.gives_way)).time
        self.check_deadline()

    def check_others(self) -> None:
        """Raise the last error if only the confirmation of a stop is left, and others wait for the line."""
        if self.failed is not None and self.told and self.others_first():
            raise self.failed

    def check_deadline(self) -> None:
        """Raise DeadlineError when the call's time is over."""
        if self.line.now >= self.deadline:
            raise DeadlineError(f"{self.peer.name}: the call's time ({self.peer.facts.timing.deadline_s:g} s) is over")

    def check_overtaken(self) -> None:
        """Raise OvertakenError when a stop waits for the line."""
        if self.gives_way and self.stop_waits():
            raise OvertakenError(f"{self.peer.name} was not asked, because a stop went first")

    def check_command(self, *, acts: bool) -> None:
        """Raise CommandCancelledError for a command that a stop was called after, and what its own check raises.

        acts: the next telegram does something.
        """
        if self.command is not None and self.command.cancelled:
            raise CommandCancelledError(
                f"{self.peer.name} was not sent the command, because a stop was called after it; start it again if it "
                "shall run"
            )
        if self.command is not None:
            self.command.check(acts=acts)

    def check_age(self, ask: Ask) -> None:
        """Make sure that what is repeated still holds: the drive's own watchdog may have acted meanwhile."""
        silent_s = self.line.now - self.partner.commanded_at
        if ask.command == "repeated" and silent_s > self.partner.watchdog_s:
            self.line.away(self.peer.name)
            raise CommandTooOldError(
                f"{self.peer.name} was last commanded {silent_s:.1f} s ago, longer than its watchdog waits; what it "
                "was commanded is not repeated, so start it again if it shall run"
            )
