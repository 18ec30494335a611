"""What came of a command, as numbers for a PLC."""

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
    from drivecomm.server import Answer


class Outcome(IntEnum):
    """How far a command has come."""

    NOTHING = 0
    """There was none yet."""
    UNDER_WAY = 1
    DONE = 2
    """The drive has confirmed it."""
    REFUSED = 3
    """Nothing was sent."""
    FAILED = 4
    """The drive said no."""
    OPEN = 5
    """It was sent, and whether the drive acted is not known."""


class Reason(IntEnum):
    """Why a command was not done."""

    NONE = 0
    NO_COMMAND = 1
    """The sequence number changed, and the command register holds none."""
    STOP_IS_ON = 2
    """The stop register holds a stop."""
    NO_LEASE = 3
    """The heartbeat has not counted yet, or no more, or somebody else commands the drive."""
    BUSY = 4
    """Another command was under way."""
    NOT_ALLOWED = 5
    """The plant file does not allow it to this door."""
    READ_ONLY = 6
    """The plant file does not arm the drive."""
    VALUE = 7
    """The drive cannot take this value."""
    CANNOT = 8
    """The drive cannot do it, or it is not the time for it."""
    DRIVE_REFUSES = 9
    NO_REPLY = 10
    NO_LINE = 11
    """The line is not open."""
    CANCELLED = 12
    """A stop came after it."""
    MISTAKE = 99
    """The server's log says which."""


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
    """What came of something that was asked for."""

    outcome: Outcome = Outcome.NOTHING
    reason: Reason = Reason.NONE


NOTHING_YET = Result()
UNDER_WAY = Result(Outcome.UNDER_WAY)


def refused(reason: Reason) -> Result:
    """Return what came of something that was not sent."""
    return Result(Outcome.REFUSED, reason)


def result_of(answer: Answer) -> Result:
    """Return an answer of the server as numbers."""
    return Result(_OUTCOMES[answer.outcome], Reason.NONE if answer.error is None else reason_of(answer.error))


def reason_of(error: Exception) -> Reason:
    """Return an error as a number."""
    return next((reason for kind, reason in _REASONS if isinstance(error, kind)), Reason.MISTAKE)
