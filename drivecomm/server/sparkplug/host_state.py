"""State of the primary host application, from its retained STATE messages with timestamps."""

from __future__ import annotations

import json
from dataclasses import dataclass

LATE_S = 120.0
"""Maximum delay in seconds of a late will; for that time, timestamps before the last one are refused."""

_LONGEST = 1000


@dataclass(frozen=True, slots=True)
class HostMessage:
    """STATE message of a host. time_ms: by the host's clock, in milliseconds since 1970."""

    online: bool
    time_ms: int


class HostState:
    """State of the primary host on one broker connection.

    Sparkplug orders the messages of a host by their timestamps, so that a late will of an earlier run does not end the
    session of a later one. Our own clock limits those timestamps: one in the future counts as now. After `LATE_S` an
    earlier timestamp than the last is accepted, because the host's clock may have been set back.
    """

    def __init__(self) -> None:
        self.online: bool | None = None
        """None before the first valid message."""
        self._last_ms = 0
        self._heard_s = 0.0

    def heard(self, message: HostMessage, *, time_ms: int, now_s: float) -> bool:
        """Process a message; return whether it counts.

        time_ms: present time in milliseconds since 1970. now_s: present time by a monotonic clock.
        """
        said_ms = min(message.time_ms, time_ms)
        if self.online is not None and now_s - self._heard_s < LATE_S and said_ms < min(self._last_ms, time_ms):
            return False
        self.online, self._last_ms, self._heard_s = message.online, said_ms, now_s
        return True


def host_message(payload: bytes) -> HostMessage | None:
    """Return the STATE message in a payload, None if it is not one."""
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
    return HostMessage(online, time_ms)
