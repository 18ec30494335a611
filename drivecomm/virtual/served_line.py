"""A virtual line that follows the clock on the wall, and the program outside that is its master."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from drivecomm.protocol import LineSettings
    from drivecomm.virtual.line import VirtualLine
    from drivecomm.virtual.listeners import Listener

_ROOM_S = 0.5
"""What a master has sent ahead, in seconds on the wire, before no more is taken from it; the rest waits on its side."""


class ServedLine:
    """Couples a virtual line with a listener; times are seconds of the line's own clock.

    What a drive says reaches the master when its last character is out. A master that sets no line settings, as over a
    pseudo-terminal and plain TCP, is taken to use those that each drive began with.
    """

    def __init__(self, line: VirtualLine, listener: Listener) -> None:
        self.line = line
        self.listener = listener
        self._settings: LineSettings | None = None
        line.configure(None)

    @property
    def descriptor(self) -> int | None:
        """What to watch for a master's bytes; None while it has sent so much ahead that no more is taken."""
        return None if self._is_full else self.listener.descriptor

    @property
    def due(self) -> float:
        """When the line needs attention again even if the master says nothing; infinite if it does not."""
        due = self.line.due
        return min(due, self.line.time + self.line.backlog_s - _ROOM_S / 2) if self._is_full else due

    def attend(self, now: float) -> None:
        """Take what the master has sent, at this time."""
        data = self.listener.receive(0.0)
        self.line.pass_time(now)
        if self.listener.settings != self._settings:
            self._settings = self.listener.settings
            self.line.configure(self._settings)
        if data:
            self.line.transmit(data)
        self.follow(now)

    def follow(self, now: float) -> None:
        """Let the line's time pass up to now, and hand the master what it hears."""
        self.line.pass_time(now)
        heard = self.line.take()
        if heard:
            self.listener.send(heard)

    @property
    def _is_full(self) -> bool:
        return self.line.backlog_s > _ROOM_S
