"""Whether the primary host application is online, by its STATE messages: retained, each with a time in it."""

from __future__ import annotations

import json
from dataclasses import dataclass

LATE_S = 120.0
"""How late a broker may deliver the will of a host's earlier run; so long an earlier time than the last is refused."""

_LONGEST = 1000


@dataclass(frozen=True, slots=True)
class HostMessage:
    """What a host says of itself. time_ms: by its own clock, in milliseconds since 1970."""

    online: bool
    time_ms: int


class HostState:
    """State of the primary host on one broker, and so of one connection.

    Sparkplug orders the messages of a host by the times in them, so that the late will of an earlier run does not end
    the session of a later one. Our own clock bounds those times: one from the future counts as now, and after `LATE_S`
    an earlier time than the last is believed, because a host's clock may have been set back.
    """

    def __init__(self) -> None:
        self.online: bool | None = None
        """None as long as no message counted."""
        self._last_ms = 0
        self._heard_s = 0.0

    def heard(self, message: HostMessage, *, time_ms: int, now_s: float) -> bool:
        """Take a message; return whether it counts.

        time_ms: now, in milliseconds since 1970. now_s: now, by a clock that nobody sets.
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
