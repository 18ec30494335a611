"""What a drive hears of telegrams that are sent with other line settings than its own, and what it finds in them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivecomm.protocol import Damaged, Framed, Framer
from drivecomm.virtual import heard

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from drivecomm.protocol import Codec, Direction, LineSettings, Message


def character_map(sender: LineSettings, receiver: LineSettings) -> bytes | None:
    """Return what a receiver makes of each of 256 characters; None where that depends on those around it.

    It does not when both have the same baud rate, the sender's characters last as long as the receiver's or longer, so
    that each start bit finds the receiver waiting for it, and none of them is taken for two.
    """
    receiver_bits = 1 + receiver.bytesize + (receiver.parity != "N") + 1
    sender_bits = 1 + sender.bytesize + (sender.parity != "N") + sender.stopbits
    if sender.baudrate != receiver.baudrate or receiver_bits > sender_bits:
        return None
    each = [heard(bytes([code]), sender, receiver) for code in range(256)]
    return b"".join(each) if all(len(one) == 1 for one in each) else None


@dataclass(frozen=True, slots=True, kw_only=True)
class Reader:
    """Somebody who looks for telegrams in what is heard. means: whether a telegram is one that it takes for its own."""

    codec: Codec
    direction: Direction
    means: Callable[[Message], bool]

    def taken(self, pieces: Iterable[bytes]) -> tuple[int, Framed] | None:
        """Return the first telegram that it takes for its own, and how many characters came before it."""
        framer = Framer(self.codec, self.direction)
        done = 0
        for piece in pieces:
            for find in framer.feed(piece):
                if isinstance(find, Framed) and self.means(find.message):
                    return done, find
                if not isinstance(find, Damaged):
                    done += len(find.data)
        return None

    def reads_whole(self, data: bytes) -> bool:
        """Whether it reads just one telegram in these bytes, from the first to the last."""
        return [find.data for find in Framer(self.codec, self.direction).feed(data) if isinstance(find, Framed)] == [
            data
        ]


@dataclass(frozen=True, slots=True)
class Hearing:
    """How traffic is heard. settings: with which; hears: what becomes of each character; reader: who looks into it."""

    settings: LineSettings
    hears: bytes
    reader: Reader
