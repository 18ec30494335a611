"""Parameter writes through a server, with their callers, for the texts of changes between backups."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from drivecomm.server.door import CommandRequest

CHANGING = frozenset({"write", "write_and_read", "call", "set_watchdog", "keep", "select_setup"})
"""Verbs that may change the settings of a drive."""


@dataclass(frozen=True, slots=True)
class Write:
    """One write. number: number of its record in the audit. time_s: in seconds since 1970."""

    who: str
    number: int
    time_s: float


class Writes:
    """The latest write of each parameter, by drive and by the name used for the write."""

    def __init__(self) -> None:
        self._known: dict[str, dict[str, Write]] = {}
        self._last_s: dict[str, float] = {}

    def note(self, drive: str, command: CommandRequest, write: Write, *, now_s: float) -> None:
        """Record a command that may have changed parameters. now_s: on a monotonic clock."""
        if command.verb not in CHANGING:
            return
        self._last_s[drive] = now_s
        parameter = command.arguments.get("parameter")
        if parameter is not None:
            self._known.setdefault(drive, {})[str(parameter)] = write

    def last_s(self, drive: str) -> float | None:
        """Return the time of the last write to a drive, on the clock of `note`, or None without one."""
        return self._last_s.get(drive)

    def of(self, drive: str, *names: str) -> Write | None:
        """Return the latest write of a parameter, which may have several names, or None without one."""
        known = self._known.get(drive, {})
        return max((known[name] for name in names if name in known), key=lambda each: each.time_s, default=None)

    def words_for(self, drive: str, address: str, common: str = "", *, after_s: float = 0.0) -> str:
        """Return the caller of a parameter's latest write as a text to add to a change.

        The text is empty without a write after `after_s`. common: its common name. after_s: in seconds since 1970.
        """
        names = [address, address.partition("[")[0], *([common] if common else [])]
        write = self.of(drive, *names)
        if write is None or write.time_s < after_s:
            return ""
        when = datetime.fromtimestamp(write.time_s, UTC)
        return f" ({write.who}, {when:%Y-%m-%d %H:%M} UTC, audit record {write.number})"
