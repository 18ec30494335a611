"""Typical damage of telegrams, recognised by the repair that makes the telegram sound again."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivecomm.errors import TelegramError
from drivecomm.protocol import Framed, Framer

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from drivecomm.protocol import Codec, Direction, Find

_SHORTEST = 4
"""Minimum length in bytes; shorter data fits some telegram of some protocol by chance."""


@dataclass(frozen=True, slots=True)
class Damage:
    """Probable damage of a telegram. cause, remedy: plain sentences without a full stop."""

    cause: str
    remedy: str


def telegrams_among_noise(data: bytes, codec: Codec, direction: Direction) -> Sequence[Find]:
    """Return the telegrams in the data and the noise between them.

    The result is empty if telegrams make up less than half of the data.
    """
    framer = Framer(codec, direction)
    finds = [*framer.feed(data), *framer.flush()]
    sound = sum(len(find.data) for find in finds if isinstance(find, Framed) and len(find.data) >= _SHORTEST)
    return finds if 2 * sound >= len(data) else ()


def likely_damage(data: bytes, codec: Codec, direction: Direction) -> Damage | None:
    """Return the probable damage of a telegram, or None if no typical damage explains the data."""
    if len(data) < _SHORTEST:
        return None
    for damage, candidates in _REPAIRS:
        if any(_is_telegram(each, codec, direction) for each in candidates(data)):
            return damage
    return None


def _is_telegram(data: bytes, codec: Codec, direction: Direction) -> bool:
    try:
        codec.decode(data, direction)
    except TelegramError:
        return False
    return True


def _check_bytes_exchanged(data: bytes) -> Iterator[bytes]:
    if data[-1] != data[-2]:
        yield data[:-2] + data[:-3:-1]


def _without_bit_7(data: bytes) -> Iterator[bytes]:
    if any(byte & 0x80 for byte in data):
        yield bytes(byte & 0x7F for byte in data)


def _with_a_first_byte(data: bytes) -> Iterator[bytes]:
    return (bytes([byte]) + data for byte in range(256))


def _with_a_last_byte(data: bytes) -> Iterator[bytes]:
    return (data + bytes([byte]) for byte in range(256))


_TRANSMITTER = "look for a transmitter that is switched late or off early (RS-485 direction control)"

_REPAIRS: Sequence[tuple[Damage, Callable[[bytes], Iterator[bytes]]]] = (
    (
        Damage("its two check bytes are in the wrong order", "the sender exchanges the check bytes; correct it there"),
        _check_bytes_exchanged,
    ),
    (
        Damage("bit 7 is set in characters that have 7 bits", "set 7 data bits with parity, as the drive has it"),
        _without_bit_7,
    ),
    (Damage("its first byte is missing", _TRANSMITTER), _with_a_first_byte),
    (Damage("its last byte is missing", _TRANSMITTER), _with_a_last_byte),
)
