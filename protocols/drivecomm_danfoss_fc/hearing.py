"""Telegrams as a drive receives them: requests, and the text replies of other drives.

A drive receives by LGE and by silence, and does not look for STX inside a telegram (specification, section 3). A reply
of another drive is as long as a request, and counts as a request to that drive. A text reply is not: it must be
recognised, so that no telegram is found in the middle of it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.errors import TelegramError
from drivecomm_danfoss_fc.telegrams import DanfossFcCodec, is_text

if TYPE_CHECKING:
    from drivecomm.protocol import Direction, Message

_STX, _LGE, _EMPTY_TEXT_LGE = 0x02, 1, 10
_HEAD = 7
"""Number of bytes up to IND, which distinguishes text from numbers."""


class DriveCodec(DanfossFcCodec):
    """Codec of telegrams as a drive receives them: requests, and text replies of other drives, decoded as replies."""

    def __init__(self, pnu_bits: int) -> None:
        super().__init__(pnu_bits)
        self.alike = ("danfoss-fc", pnu_bits)

    def measure(self, head: bytes, direction: Direction) -> int:
        """Return the length of the telegram that begins with these bytes, see `Codec.measure`."""
        needed = super().measure(head, direction)
        if needed or direction == "reply" or head[0] != _STX or head[_LGE] < _EMPTY_TEXT_LGE:
            return needed
        if len(head) < _HEAD:
            return _HEAD
        return head[_LGE] + 2 if _is_text_reply(head) else 0

    def decode(self, data: bytes, direction: Direction) -> Message:
        """Return the content of one telegram. Raises TelegramError."""
        try:
            return super().decode(data, direction)
        except TelegramError:
            if direction == "request" and len(data) >= _HEAD and _is_text_reply(data):
                return super().decode(data, "reply")
            raise


def _is_text_reply(head: bytes) -> bool:
    return is_text(head[3] >> 4, int.from_bytes(head[5:7], "big"), "reply")
