"""Characters that a receiver decodes if its line settings differ from those of the sender."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivecomm.protocol import LineSettings


def heard(data: bytes, sender: LineSettings, receiver: LineSettings) -> bytes:
    """Return the characters that a receiver decodes while a sender sends these.

    The level of the line is sampled as a UART does: wait for a start bit, then take each bit in its middle. Parity is
    not checked and a missing stop bit is accepted, as in common receivers with default settings.
    """
    if sender is receiver or sender == receiver:
        return data if receiver.bytesize == 8 else data.translate(_SEVEN_BITS)
    return _sampled(data, sender, receiver)


def received(data: bytes, sender: LineSettings, receiver: LineSettings) -> list[tuple[int, bool]]:
    """Return the same characters as `heard`, each with whether its parity and stop bit are right."""
    return list(_characters(list(_levels(data, sender)), sender.baudrate / receiver.baudrate, receiver))


_SEVEN_BITS = bytes(byte & 0x7F for byte in range(256))


@lru_cache(maxsize=4096)
def _sampled(data: bytes, sender: LineSettings, receiver: LineSettings) -> bytes:
    levels = list(_levels(data, sender))
    return bytes(character for character, _ in _characters(levels, sender.baudrate / receiver.baudrate, receiver))


def _levels(data: bytes, sender: LineSettings) -> Iterator[int]:
    """Yield the line's level, one entry for each bit time of the sender."""
    for byte in data:
        bits = [byte >> place & 1 for place in range(sender.bytesize)]
        yield 0
        yield from bits
        if sender.parity != "N":
            yield _parity(bits, sender)
        yield 1
        if sender.stopbits > 1:
            yield 1


def _parity(bits: list[int], settings: LineSettings) -> int:
    return {"E": sum(bits) % 2, "O": 1 - sum(bits) % 2, "M": 1, "S": 0}[settings.parity]


def _characters(levels: list[int], step: float, receiver: LineSettings) -> Iterator[tuple[int, bool]]:
    """Yield characters and whether they are right. step: the receiver's bit time in bit times of the sender."""
    at = 0.0
    length = receiver.bytesize + (receiver.parity != "N")
    while True:
        place = int(at)
        while place < len(levels) and levels[place]:
            place += 1
            at = float(place)
        if place >= len(levels):
            return
        middle = at + step / 2
        samples = [_level(levels, middle + step * bit) for bit in range(1, length + 2)]
        bits = samples[: receiver.bytesize]
        right = receiver.parity == "N" or samples[receiver.bytesize] == _parity(bits, receiver)
        yield sum(bit << place for place, bit in enumerate(bits)), right and bool(samples[length])
        at = middle + step * (length + 1)
        if not samples[length]:
            at += step / 2


def _level(levels: list[int], at: float) -> int:
    return levels[int(at)] if at < len(levels) else 1
