"""A port that costs nothing: its reply is there as soon as the request is, and waiting is only arithmetic."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from conversation import Conversation

    from drivecomm.protocol import LineSettings


class CannedPort:
    """The line of one conversation, without a line."""

    paced = False
    real_time = False
    descriptor = None

    def __init__(self, conversation: Conversation) -> None:
        self._request = conversation.request
        self._reply = conversation.reply
        self._ready = b""
        self._now = 0.0

    def now(self) -> float:
        """Return the time, which passes only by waiting."""
        return self._now

    def wall_time(self) -> float:
        """Return the same time."""
        return self._now

    def configure(self, settings: LineSettings) -> str:  # noqa: ARG002 - any will do
        """Accept the settings."""
        return ""

    def write(self, data: bytes) -> None:
        """Have the reply ready when the request was written, alone or behind a closing telegram."""
        if data.endswith(self._request):
            self._ready = self._reply

    def read(self, until: float, at_least: int) -> bytes:  # noqa: ARG002 - all of a reply or nothing
        """Return the reply, or let the time pass."""
        data, self._ready = self._ready, b""
        if not data:
            self.wait(until)
        return data

    def take(self) -> bytes:
        """Return what is there now."""
        data, self._ready = self._ready, b""
        return data

    def wait(self, until: float) -> None:
        """Let the time pass."""
        self._now = max(self._now, until)

    def hold_back(self, at_least: int) -> None:
        """Nothing to hold back: replies are whole."""

    def close(self) -> None:
        """Nothing to give back."""
