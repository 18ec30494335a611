"""What a serial port is made of below its clock: something that takes bytes and hands them over.

There is one kind of channel for each way an operating system or pyserial waits for bytes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from drivecomm.protocol import LineSettings


class ChannelGoneError(Exception):
    """The other end has gone: unplugged, closed, or it takes no more bytes. The text says which."""


class SettingsRefusedError(Exception):
    """The port stays as it is; the text says why, as far as that is known."""


class Channel(Protocol):
    """An open port. Everything but `close` may raise ChannelGoneError; foreign exceptions stay inside."""

    @property
    def paced(self) -> bool:
        """Whether the characters are sent at the line's speed, and `send` returns before they are out."""

    @property
    def descriptor(self) -> int | None:
        """What becomes readable when bytes are there, or when the other end has gone; None: there is no such thing."""

    def apply(self, settings: LineSettings) -> str:
        """Set the line settings without closing; return a note on what is not carried. Raises SettingsRefusedError."""

    def send(self, data: bytes, limit_s: float) -> None:
        """Hand over all bytes within this time."""

    def receive(self, until: float, wanted: int) -> bytes:
        """Return what is there as soon as it is so much; at `until` (monotonic seconds) what there is."""

    def take(self) -> bytes:
        """Return what is there; never wait."""

    def hold_back(self, at_least: int) -> None:
        """Make the descriptor readable only for so many bytes, where the system can; fewer can still be taken."""

    def close(self) -> None:
        """Give the port back; never raises."""
