"""The layer below the clock of a serial port: channels, which send and receive bytes.

There is one kind of channel for each way in which an operating system or pyserial waits for bytes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from drivecomm.protocol import LineSettings


class ChannelGoneError(Exception):
    """The other end is gone: unplugged, closed, or not accepting bytes; the text says which."""


class SettingsRefusedError(Exception):
    """The line settings were refused and the port is unchanged; the text contains the reason if known."""


class Channel(Protocol):
    """Open port. All methods except `close` may raise ChannelGoneError; no foreign exception leaves a channel."""

    @property
    def paced(self) -> bool:
        """Whether characters are sent at line speed and `send` returns before they are sent."""

    @property
    def descriptor(self) -> int | None:
        """Descriptor that is readable when bytes have arrived or the other end is gone; None if there is none."""

    def apply(self, settings: LineSettings) -> str:
        """Set the line settings of the open port; return a note on unsupported ones. Raises SettingsRefusedError."""

    def send(self, data: bytes, limit_s: float) -> None:
        """Pass on all bytes within limit_s seconds."""

    def receive(self, until: float, wanted: int) -> bytes:
        """Return the received bytes once there are `wanted` bytes, or at `until` whatever has arrived.

        until: in seconds of the monotonic clock.
        """

    def take(self) -> bytes:
        """Return the received bytes without waiting."""

    def hold_back(self, at_least: int) -> None:
        """Make the descriptor readable only for this many bytes if the system can; `take` still returns fewer."""

    def close(self) -> None:
        """Close the port; never raises."""
