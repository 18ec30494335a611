"""The other framings of Modbus, ASCII and TCP, which carry the same content as RTU.

ASCII (Modbus over serial line V1.02, 2.5.2): a colon, each byte of address, function and data as two hexadecimal
digits, the longitudinal check likewise, CR and LF. TCP (Modbus messaging on TCP/IP V1.0b, 3.1.3): the number of the
transaction, 0000 for Modbus, number of following bytes, the unit, function and data; the reply repeats the transaction.
"""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from drivecomm.errors import TelegramError
from drivecomm.protocol.schema import crc16, wrong_field
from drivecomm_modbus.codec import ModbusCodec, ModbusDriveCodec, length_of, transaction_of
from drivecomm_modbus.messages import Request
from drivecomm_modbus.telegrams import BROADCAST, EVERY_ADDRESS

if TYPE_CHECKING:
    from drivecomm.protocol import Direction, Message
    from drivecomm_modbus.options import ModbusOptions

_START, _END = b":", b"\r\n"
_CHECK_BYTES = 2
_SHORTEST = {"request": 2, "reply": 3}
_DIGITS = re.compile(rb"[0-9A-F]*")
_HEADER = 6
_MOST_FOLLOWING = 254


def lrc(content: bytes) -> int:
    """Return the longitudinal check, which makes the sum of all bytes 0."""
    return -sum(content) & 0xFF


class AsciiCodec(ModbusCodec):
    """Codec for ASCII telegrams. Digits above 9 are capitals, as the standard requires."""

    def measure(self, head: bytes, direction: Direction) -> int:
        """Return the length of the telegram that begins with these bytes, see `Codec.measure`."""
        least = _ascii_length(_SHORTEST[direction])
        if not head:
            return least
        if head[:1] != _START:
            return 0
        digits = _digits(head)
        content = bytes.fromhex(digits[: len(digits) & ~1].decode())
        if not self._can_begin(content, direction):
            return 0
        if len(content) > 1 and not length_of(content, direction):
            # For an unknown function, the end mark shows where the telegram ends.
            end = head.find(_END)
            return end + len(_END) if end >= 0 else len(head) + 1
        needed = least if len(content) < 2 else _ascii_length(length_of(content, direction) - _CHECK_BYTES)
        last = len(_START) + len(digits)
        if last < min(len(head), needed - len(_END)):
            return 0
        return needed

    def decode(self, data: bytes, direction: Direction) -> Message:
        """Return the content of one telegram.

        Raises TelegramError: marks and length are checked first, then LRC, then fields.
        """
        content = self.content(data)
        needed = length_of(content, direction) - _CHECK_BYTES
        if needed > 0 and needed != len(content):
            raise TelegramError("length", f"{len(content)} bytes, and function {content[1]:02X} has {needed}")
        if lrc(content) != int(data[-4:-2], 16):
            raise TelegramError("checksum", f"LRC {data[-4:-2].decode()} is wrong")
        return super().decode(content + crc16(content), direction)

    def encode(self, message: Any) -> bytes:
        """Return the bytes of one telegram."""
        content = super().encode(message)[:-_CHECK_BYTES]
        return b"%b%b%02X%b" % (_START, content.hex().upper().encode(), lrc(content), _END)

    def content(self, data: bytes) -> bytes:
        """Return the address, function and data of one telegram. Raises TelegramError for wrong marks."""
        digits = data[1:-2]
        if len(data) < _ascii_length(2) or not len(data) % 2:
            raise TelegramError("length", f"{len(data)} characters are not a telegram; the shortest has 9")
        if data[:1] != _START or data[-2:] != _END or not _DIGITS.fullmatch(digits):
            raise TelegramError("framing", "it is not a colon, capital hexadecimal digits, CR and LF")
        return bytes.fromhex(digits[:-2].decode())

    def _can_begin(self, content: bytes, direction: Direction) -> bool:
        return not content or content[0] in self._addresses or (direction == "request" and content[0] == BROADCAST)


class TcpCodec(ModbusCodec):
    """Codec for telegrams over TCP, each with a transaction number.

    A request without a number gets one that is derived from its content, so that replies to different requests differ.
    """

    def measure(self, head: bytes, direction: Direction) -> int:
        """Return the length of the telegram that begins with these bytes, see `Codec.measure`."""
        if head[2 : _HEADER - 1].strip(b"\0"):
            return 0
        if len(head) < _HEADER:
            return _HEADER + _SHORTEST[direction]
        if not _SHORTEST[direction] <= head[_HEADER - 1] <= _MOST_FOLLOWING:
            return 0
        return _HEADER + head[_HEADER - 1]

    def decode(self, data: bytes, direction: Direction) -> Message:
        """Return the content of one telegram. Raises TelegramError: length is checked first, then fields."""
        content = self.content(data)
        message: Any = super().decode(content + crc16(content), direction)
        return replace(message, transaction=self.transaction(data))  # type: ignore[no-any-return]

    def encode(self, message: Any) -> bytes:
        """Return the bytes of one telegram."""
        content, given = super().encode(replace(message, transaction=None))[:-_CHECK_BYTES], message.transaction
        if given is not None and (type(given) is not int or not 0 <= given <= 0xFFFF):
            raise wrong_field("transaction", f"{given!r} is not 0 to 65535")
        if given is None and not isinstance(message, Request):
            raise wrong_field("transaction", "a reply repeats that of its request")
        transaction = transaction_of(message) if given is None else given
        return transaction.to_bytes(2, "big") + b"\0\0" + len(content).to_bytes(2, "big") + content

    def content(self, data: bytes) -> bytes:
        """Return the unit, function and data of one telegram. Raises TelegramError for a wrong header."""
        if len(data) < _HEADER + 2 or int.from_bytes(data[4:6], "big") != len(data) - _HEADER:
            raise TelegramError("length", f"{len(data)} bytes are not as many as its header says")
        if data[2:4] != b"\0\0":
            raise TelegramError("framing", f"protocol {data[2:4].hex().upper()} is not 0000, which is Modbus")
        return data[_HEADER:]

    def transaction(self, data: bytes) -> int | None:
        """Return the transaction number of a telegram."""
        return int.from_bytes(data[:2], "big")


_CODECS: dict[str, type[ModbusCodec]] = {"rtu": ModbusCodec, "ascii": AsciiCodec, "tcp": TcpCodec}


def codec_of(options: ModbusOptions) -> ModbusCodec:
    """Return the codec for drives with these options."""
    return _CODECS[options.framing](options.addresses)


def drive_codec(options: ModbusOptions) -> ModbusCodec:
    """Return the codec as a drive uses it; in framings with a start mark, it ignores the replies of other drives."""
    kind = ModbusDriveCodec if options.framing == "rtu" else _CODECS[options.framing]
    return kind(EVERY_ADDRESS)


def blind_spots(data: bytes, _direction: Direction) -> frozenset[int]:
    """Return the positions where a wrong bit is not detected: over TCP all behind the header; TCP checks these."""
    is_tcp = data[2:5] == b"\0\0\0" and len(data) == _HEADER + data[_HEADER - 1] and crc16(data[:-2]) != data[-2:]
    return frozenset({0, 1, *range(_HEADER, len(data))}) if is_tcp else frozenset()


def _ascii_length(content: int) -> int:
    """Return the number of characters in a telegram with this many bytes of address, function and data."""
    return len(_START) + 2 * (content + 1) + len(_END)


def _digits(head: bytes) -> bytes:
    found = _DIGITS.match(head, len(_START))
    return found[0] if found else b""
