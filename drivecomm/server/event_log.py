"""The log of events; a lost line is logged once for all of its drives."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from drivecomm.server.observations import CurrentValue, Event

_log = logging.getLogger("drivecomm.server")

_LOUD = frozenset({"fault", "silent", "warning", "link loss", "line", "door", "alarm"})


class EventLog:
    """The writer of events to the log. is_up: returns whether the line of the given name is open."""

    def __init__(self, is_up: Callable[[str], bool]) -> None:
        self._is_up = is_up
        self._silent_with_line: set[str] = set()

    def take(self, _: Sequence[CurrentValue], events: Sequence[Event]) -> None:
        """Log events, except those that only follow from a lost line."""
        for event in events:
            if event.kind == "silent" and not self._is_up(event.line):
                self._silent_with_line.add(event.drive)
            elif event.kind == "answers" and event.drive in self._silent_with_line:
                self._silent_with_line.discard(event.drive)
            else:
                if event.kind == "silent":
                    self._silent_with_line.discard(event.drive)
                _write(event)


def _write(event: Event) -> None:
    about = " ".join(part for part in (event.line, event.drive) if part)
    level = logging.WARNING if event.kind in _LOUD else logging.INFO
    _log.log(
        level,
        "%s%s: %s%s",
        f"{about}: " if about else "",
        event.kind,
        event.text,
        f", by {event.who}" if event.who else "",
    )
