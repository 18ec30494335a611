"""Port without cost: the reply is there as soon as the request is sent, and waiting only adds to the time."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from conversation import Conversation

    from drivecomm.protocol import LineSettings


class CannedPort:
    """Port that replays one exchange without a line."""

    paced = False
    real_time = False
    descriptor = None

    def __init__(self, conversation: Conversation) -> None:
        self._request = conversation.request
        self._reply = conversation.reply
        self._ready = b""
        self._now = 0.0

    def now(self) -> float:
        """Return the time, which passes only during waits."""
        return self._now

    def wall_time(self) -> float:
        """Return the same time as `now`."""
        return self._now

    def configure(self, settings: LineSettings) -> str:  # noqa: ARG002 - accepts any settings
        """Accept any settings."""
        return ""

    def write(self, data: bytes) -> None:
        """Make the reply available after the request, even if a closing telegram precedes it."""
        if data.endswith(self._request):
            self._ready = self._reply

    def read(self, until: float, at_least: int) -> bytes:  # noqa: ARG002 - delivers a whole reply or nothing
        """Return the reply, or advance the time."""
        data, self._ready = self._ready, b""
        if not data:
            self.wait(until)
        return data

    def take(self) -> bytes:
        """Return the bytes available now."""
        data, self._ready = self._ready, b""
        return data

    def wait(self, until: float) -> None:
        """Advance the time."""
        self._now = max(self._now, until)

    def hold_back(self, at_least: int) -> None:
        """Do nothing: replies are always complete."""

    def close(self) -> None:
        """Do nothing: there is nothing to release."""
