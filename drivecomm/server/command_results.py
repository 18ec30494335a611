"""What a command results in: its outcome, its error, and records of it that keep nothing from being sent."""

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

    from drivecomm.server.door import Command, Outcome

T = TypeVar("T")

_log = logging.getLogger("drivecomm.server")


def outcome_of(error: Exception) -> Outcome:
    """Return what is known of a command that ended with this error."""
    if not isinstance(error, DriveCommError):
        return "open"
    if isinstance(error, UsageError | CommandCancelledError):
        return "refused"
    if isinstance(error, NotAnsweringError):
        # It was not asked.
        return "failed"
    return "open" if isinstance(error, ReplyError | LinkError) else "failed"


def error_of(command: Command, error: Exception) -> DriveCommError:
    """Return an error as an answer has it; one that nobody raised on purpose is a mistake, of a package perhaps."""
    if isinstance(error, DriveCommError):
        return error
    _log.error("%s of %s", command.verb, command.drive, exc_info=error)
    return DriveCommError(f"{command.verb} of {command.drive} has failed by a mistake in the program: {error!r}")


def noted(write: Callable[..., T], *content: Any) -> T | None:
    """Call what writes a record; that this fails keeps nothing from being done, a stop least of all."""
    try:
        return write(*content)
    except Exception:  # noqa: BLE001 - see above
        _log.exception("writing down a command")
        return None
