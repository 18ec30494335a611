"""A virtual drive's ear on a line: bytes in, its replies out."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.framing import Framer, Noise

if TYPE_CHECKING:
    from drivecomm.framing import Find
    from drivecomm.protocol import VirtualDrive, VirtualReply


class Station:
    """Feeds one virtual drive with everything that is heard on its line, replies of other drives included."""

    def __init__(self, drive: VirtualDrive) -> None:
        self.drive = drive
        self._framer = Framer(drive.codec, "request")
        self._heard_at = 0.0

    def hear(self, data: bytes, began: float, ended: float) -> list[VirtualReply]:
        """Take bytes that were on the line between two times; return what the drive answers to them."""
        finds: list[Find] = []
        if began - self._heard_at > self.drive.gap_s:
            finds += self._framer.flush()
        self._heard_at = ended
        finds += self._framer.feed(data)
        answers = (self.drive.hear(find, ended) for find in finds if not isinstance(find, Noise))
        return [answer for answer in answers if answer is not None]
