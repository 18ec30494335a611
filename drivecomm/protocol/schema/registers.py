"""Registers and coils in telegrams: words and bits as the characters of a leaf, and the cyclic check beside them.

What is written is checked: a list that holds anything else than such numbers is a TelegramError that names the field.
"""

from __future__ import annotations

from struct import pack, unpack
from typing import TYPE_CHECKING

from drivecomm.errors import TelegramError

if TYPE_CHECKING:
    from collections.abc import Sequence


def _crc_of_byte(byte: int) -> int:
    for _ in range(8):
        byte = byte >> 1 ^ (0xA001 if byte & 1 else 0)
    return byte


_CRC = tuple(map(_crc_of_byte, range(256)))


def crc16(covered: bytes) -> bytes:
    """Return the CRC-16 with polynomial A001H, reflected, beginning with FFFFH, its low byte first."""
    crc = 0xFFFF
    for byte in covered:
        crc = crc >> 8 ^ _CRC[(crc ^ byte) & 0xFF]
    return bytes((crc & 0xFF, crc >> 8))


def words_in(content: str) -> tuple[int, ...]:
    """Return the words of 16 bits, high byte first, that these characters are."""
    return unpack(f">{len(content) // 2}H", content.encode("latin-1"))


def bits_in(content: str) -> tuple[int, ...]:
    """Return the bits that these characters are, the lowest of each first."""
    return tuple(byte >> bit & 1 for byte in content.encode("latin-1") for bit in range(8))


def words_as(values: object) -> str:
    """Return words of 16 bits as characters."""
    words = numbers(values, 0xFFFF)
    return pack(f">{len(words)}H", *words).decode("latin-1")


def bits_as(values: object) -> str:
    """Return bits as characters, the first one lowest; the last character is filled up with zeros."""
    bits = numbers(values, 1)
    data = bytearray((len(bits) + 7) // 8)
    for place, bit in enumerate(bits):
        data[place // 8] |= bit << place % 8
    return data.decode("latin-1")


def numbers(values: object, highest: int, name: str = "values") -> Sequence[int]:
    """Return these values if they are whole numbers from 0 on. Raises TelegramError, with the name of the field."""
    if values is None:
        raise TelegramError("field", f"{name}: they are missing", field=name)
    if not isinstance(values, tuple) or any(type(each) is not int or not 0 <= each <= highest for each in values):
        text = f"{name}: {values!r} is no list of numbers from 0 to {highest}"
        raise TelegramError("field", text, field=name)
    return values
