"""Parts of telegrams with registers and coils: words, bits and bytes as the characters of a leaf, and CRC-16.

Values to be written are checked: a list with anything but valid numbers raises a TelegramError that names the field.
"""

from __future__ import annotations

from struct import pack, unpack
from typing import TYPE_CHECKING, Any

from drivecomm.errors import TelegramError
from drivecomm.protocol.schema.leaf import Leaf

if TYPE_CHECKING:
    from collections.abc import Sequence


def _crc_of_byte(byte: int) -> int:
    for _ in range(8):
        byte = byte >> 1 ^ (0xA001 if byte & 1 else 0)
    return byte


_CRC = tuple(map(_crc_of_byte, range(256)))


def crc16(covered: bytes) -> bytes:
    """Return the CRC-16 with polynomial A001H (reflected) and initial value FFFFH, its low byte first."""
    crc = 0xFFFF
    for byte in covered:
        crc = crc >> 8 ^ _CRC[(crc ^ byte) & 0xFF]
    return bytes((crc & 0xFF, crc >> 8))


def words_in(content: str) -> tuple[int, ...]:
    """Return the 16-bit words in these characters, high byte first."""
    return unpack(f">{len(content) // 2}H", content.encode("latin-1"))


def bits_in(content: str) -> tuple[int, ...]:
    """Return the bits in these characters, the lowest bit of each character first."""
    return tuple(byte >> bit & 1 for byte in content.encode("latin-1") for bit in range(8))


def words_as(values: object) -> str:
    """Return 16-bit words as characters."""
    words = numbers(values, 0xFFFF)
    return pack(f">{len(words)}H", *words).decode("latin-1")


def bits_as(values: object) -> str:
    """Return bits as characters, the lowest bit first; the last character is filled up with zeros."""
    bits = numbers(values, 1)
    data = bytearray((len(bits) + 7) // 8)
    for place, bit in enumerate(bits):
        data[place // 8] |= bit << place % 8
    return data.decode("latin-1")


def numbers(values: object, highest: int, name: str = "values") -> Sequence[int]:
    """Return these values if they are whole numbers from 0 to `highest`. Raises TelegramError that names the field."""
    if values is None:
        raise wrong_field(name, "they are missing")
    if not isinstance(values, tuple) or any(type(each) is not int or not 0 <= each <= highest for each in values):
        raise wrong_field(name, f"{values!r} is not a list of numbers from 0 to {highest}")
    return values


def bytes_in(content: str) -> str:
    """Return these characters as hexadecimal text."""
    return content.encode("latin-1").hex(" ").upper()


def bytes_as(text: object, name: str, most: int) -> str:
    """Return hexadecimal text as characters. Raises TelegramError for other text, or for too many bytes."""
    try:
        data = bytes.fromhex(str(text))
    except ValueError:
        what = "they are missing" if text is None else f"{text!r} does not consist of hexadecimal bytes"
        raise wrong_field(name, what) from None
    if len(data) > most:
        raise wrong_field(name, f"{len(data)} bytes are more than fit")
    return data.decode("latin-1")


def numbered_texts_in(content: str) -> tuple[tuple[int, ...], tuple[str, ...]]:
    """Return the numbers and the texts of a list whose entries are number, length and text."""
    ids, texts, place = [], [], 0
    while place + 2 <= len(content):
        size = ord(content[place + 1])
        ids.append(ord(content[place]))
        texts.append(content[place + 2 : place + 2 + size])
        place += 2 + size
    return tuple(ids), tuple(texts)


def numbered_texts_as(ids: object, texts: object, name_of_ids: str, name_of_texts: str) -> str:
    """Return a list of numbers and texts as characters; reverses `numbered_texts_in`."""
    checked = numbers(ids, 0xFF, name_of_ids)
    if not isinstance(texts, tuple) or len(texts) != len(checked) or not all(isinstance(each, str) for each in texts):
        raise wrong_field(name_of_texts, f"there is not one text for each of {name_of_ids}")
    try:
        encoded = [each.encode("latin-1") for each in texts]
        data = b"".join(bytes((number, len(each))) + each for number, each in zip(checked, encoded, strict=True))
    except ValueError:
        raise wrong_field(name_of_texts, "a text is too long, or is not made of ISO 8859-1") from None
    return data.decode("latin-1")


def whole(size: int, allowed: range, meaning: str) -> Leaf:
    """Return a leaf for a whole number, high byte first, within the allowed range."""

    def checked(value: Any) -> int:
        if type(value) is not int or value not in allowed:
            raise ValueError(f"{value!r} is not {allowed.start} to {allowed.stop - 1}")
        return value

    def parse(found: bytes) -> int:
        return checked(int.from_bytes(found, "big"))

    return Leaf(size, parse, lambda value: checked(value).to_bytes(size, "big"), meaning=meaning)


def wrong_field(name: str, text: str) -> TelegramError:
    """Return the error for a field with invalid content."""
    return TelegramError("field", f"{name}: {text}", field=name)
