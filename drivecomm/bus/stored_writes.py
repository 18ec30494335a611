"""Guard against EEPROM wear: counts the stored writes of each parameter, and refuses those of a cyclic writer."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

from drivecomm.errors import UsageError, shortened
from drivecomm.protocol import is_whole

if TYPE_CHECKING:
    from drivecomm.protocol import Capabilities, Model

WITHIN_S = 3600.0
ALLOWED = 10
"""Maximum number of stored writes of one parameter of one drive within an hour; only a cyclic writer makes more."""


class StoredWrites:
    """The stored writes of all drives of one bus while it is open. allowed: maximum for a parameter within an hour."""

    def __init__(self, allowed: int = ALLOWED) -> None:
        if not is_whole(allowed) or allowed < 0:
            raise UsageError(f"invalid stored_writes_per_hour = {shortened(allowed)}; give a whole number, 0 or more")
        self._allowed = allowed
        self._times: dict[tuple[str, str], deque[float]] = {}
        self._in_ram: set[tuple[str, str]] = set()

    def count(self, drive: str, parameter: str, now: float) -> None:
        """Count a write that is about to be stored. Raises UsageError if it is one too many.

        drive: PROTOCOL:ADDRESS, or PROTOCOL:* for a write to all drives, which counts for each of them. parameter: its
        one address, the same for every spelling.
        """
        protocol = drive.partition(":")[0]
        everyone = f"{protocol}:*"
        if drive == everyone:
            single = {who for who, what in self._times if what == parameter and who.startswith(f"{protocol}:")}
            stored = max((self._stored(who, parameter, now) for who in single - {everyone}), default=0)
        else:
            stored = self._stored(drive, parameter, now)
        stored += self._stored(everyone, parameter, now)
        if stored >= self._allowed:
            raise UsageError(
                f"{parameter} of {drive} was stored {stored} times within an hour, and EEPROM cells wear out; "
                "write it without store=True, or raise stored_writes_per_hour of the bus",
                says="store=True",
            )
        self._times.setdefault((drive, parameter), deque()).append(now)
        self._in_ram.discard((drive, parameter.partition("[")[0]))

    def kept_in_ram(self, drive: str, parameter: str) -> None:
        """Record a write that is not stored."""
        self._in_ram.add((drive, parameter.partition("[")[0]))

    def in_ram_only(self, drive: str) -> frozenset[str]:
        """Return the parameters of a drive, without index, whose last write was not stored."""
        everyone = f"{drive.partition(':')[0]}:*"
        return frozenset(parameter for who, parameter in self._in_ram.copy() if who in (drive, everyone))

    def _stored(self, drive: str, parameter: str, now: float) -> int:
        times = self._times.get((drive, parameter), deque())
        while times and now - times[0] >= WITHIN_S:
            times.popleft()
        return len(times)


def is_stored(capabilities: Capabilities, model: Model | None, parameter: str, *, store: bool) -> bool:
    """Return whether a write is known to go to EEPROM: by request, or because this drive has no other way."""
    if store or capabilities.volatile_writes:
        return store
    info = model.find(parameter.partition("[")[0]) if model else None
    return info is not None and info.storage == "stored"
