"""Outcomes of commands as numbers for a PLC."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING

from drivecomm.errors import (
    CommandCancelledError,
    DriveError,
    LeaseError,
    LinkError,
    NotAllowedError,
    ReadOnlyError,
    ReplyError,
    UsageError,
    ValueRefusedError,
)

if TYPE_CHECKING:
    from drivecomm.errors import DriveCommError
    from drivecomm.server import CommandAnswer


class Outcome(IntEnum):
    """Progress or outcome of a command."""

    NOTHING = 0
    """No command yet."""
    UNDER_WAY = 1
    DONE = 2
    """The drive has confirmed the command."""
    REFUSED = 3
    """Nothing was sent."""
    FAILED = 4
    """The drive has refused the command."""
    OPEN = 5
    """The command was sent, and it is unknown whether the drive acted."""


class Reason(IntEnum):
    """Reason why a command was not carried out."""

    NONE = 0
    NO_COMMAND = 1
    """The sequence number changed, but the command register holds no command."""
    STOP_IS_ON = 2
    """The stop register holds a stop."""
    NO_LEASE = 3
    """The heartbeat has not counted yet or has stopped, or another caller commands the drive."""
    BUSY = 4
    """Another command was in progress."""
    NOT_ALLOWED = 5
    """The plant file does not allow this door to send the command."""
    READ_ONLY = 6
    """The plant file does not arm the drive."""
    VALUE = 7
    """The drive does not accept this value."""
    CANNOT = 8
    """The drive does not support the command, or cannot carry it out at the moment."""
    DRIVE_REFUSES = 9
    NO_REPLY = 10
    NO_LINE = 11
    """The line is not open."""
    CANCELLED = 12
    """A later stop cancelled the command."""
    MISTAKE = 99
    """Internal error, with details in the server's log."""


_OUTCOMES = {"done": Outcome.DONE, "refused": Outcome.REFUSED, "failed": Outcome.FAILED, "open": Outcome.OPEN}
_REASONS: tuple[tuple[type[DriveCommError], Reason], ...] = (
    (LeaseError, Reason.NO_LEASE),
    (ReadOnlyError, Reason.READ_ONLY),
    (NotAllowedError, Reason.NOT_ALLOWED),
    (ValueRefusedError, Reason.VALUE),
    (UsageError, Reason.CANNOT),
    (CommandCancelledError, Reason.CANCELLED),
    (DriveError, Reason.DRIVE_REFUSES),
    (ReplyError, Reason.NO_REPLY),
    (LinkError, Reason.NO_LINE),
)


@dataclass(frozen=True, slots=True)
class Result:
    """Result of a command."""

    outcome: Outcome = Outcome.NOTHING
    reason: Reason = Reason.NONE


NOTHING_YET = Result()
UNDER_WAY = Result(Outcome.UNDER_WAY)


def refused(reason: Reason) -> Result:
    """Return the result of a command that was not sent."""
    return Result(Outcome.REFUSED, reason)


def result_of(answer: CommandAnswer) -> Result:
    """Return the numeric form of an answer from the server."""
    return Result(_OUTCOMES[answer.outcome], Reason.NONE if answer.error is None else reason_of(answer.error))


def reason_of(error: Exception) -> Reason:
    """Return the number of an error."""
    return next((reason for kind, reason in _REASONS if isinstance(error, kind)), Reason.MISTAKE)
