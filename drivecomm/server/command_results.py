"""Outcomes and errors of commands, and records that never prevent a command from being sent."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Any, TypeVar

from drivecomm.errors import (
    CommandCancelledError,
    DriveCommError,
    LinkError,
    NotAnsweringError,
    ReplyError,
    UsageError,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.server.door import CommandRequest, Outcome

T = TypeVar("T")

_log = logging.getLogger("drivecomm.server")


def outcome_of(error: Exception) -> Outcome:
    """Return the outcome of a command that ended with an error."""
    if not isinstance(error, DriveCommError):
        return "open"
    if isinstance(error, UsageError | CommandCancelledError):
        return "refused"
    if isinstance(error, NotAnsweringError):
        # The drive had been given up, so nothing was sent.
        return "failed"
    return "open" if isinstance(error, ReplyError | LinkError) else "failed"


def error_of(command: CommandRequest, error: Exception) -> DriveCommError:
    """Return the error for the answer to a command; an unexpected exception is logged and reported as a bug."""
    if isinstance(error, DriveCommError):
        return error
    _log.error("%s of %s", command.verb, command.drive, exc_info=error)
    return DriveCommError(f"{command.verb} of {command.drive} failed because of a bug in the program: {error!r}")


def record_safely(write: Callable[..., T], *content: Any) -> T | None:
    """Call `write` to record something; a failure is only logged, because it must not hold up a command or a stop."""
    try:
        return write(*content)
    except Exception:  # noqa: BLE001 - a failed record must not hold up a command
        _log.exception("writing down a command")
        return None
