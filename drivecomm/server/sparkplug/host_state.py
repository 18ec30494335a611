"""Whether the primary host application is there, by what it tells of itself: a retained message with a time in it."""

from __future__ import annotations

import json

_LONGEST = 1000


class HostState:
    """What one broker tells of the primary host; each broker has a state of its own, and so each connection."""

    def __init__(self) -> None:
        self.online: bool | None = None
        """None as long as nothing was heard that counts."""
        self._time_ms: int | None = None

    def heard(self, payload: bytes) -> bool:
        """Take what came on its topic; return whether it counts.

        What is older than what was heard before does not count: a late will of an earlier run of the host ends nothing.
        """
        said = _read(payload)
        if said is None:
            return False
        online, time_ms = said
        if self._time_ms is not None and time_ms < self._time_ms:
            return False
        self.online, self._time_ms = online, time_ms
        return True


def _read(payload: bytes) -> tuple[bool, int] | None:
    """Return whether the host is online, and since when; None for what is no such message."""
    if len(payload) > _LONGEST:
        return None
    try:
        said = json.loads(payload)
    except (ValueError, RecursionError):
        return None
    if not isinstance(said, dict):
        return None
    online, time_ms = said.get("online"), said.get("timestamp")
    if not isinstance(online, bool) or isinstance(time_ms, bool) or not isinstance(time_ms, int) or time_ms < 0:
        return None
    return online, time_ms
