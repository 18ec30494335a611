"""Modbus requests, strictly checked, and their responses. pymodbus encodes and decodes the bytes.

Its server is not used: it loses the second of two requests in one segment, possibly a stop, and it has no limits.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING

from pymodbus.pdu import ExceptionResponse
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    ReadInputRegistersRequest,
    ReadWriteMultipleRegistersRequest,
    WriteMultipleRegistersRequest,
    WriteMultipleRegistersResponse,
    WriteSingleRegisterRequest,
    WriteSingleRegisterResponse,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from pymodbus.pdu import ModbusPDU

_READ_HOLDING, _READ_INPUT, _WRITE_ONE, _WRITE, _READ_WRITE = 3, 4, 6, 16, 23
_REQUESTS: dict[int, type[ModbusPDU]] = {
    _READ_HOLDING: ReadHoldingRegistersRequest,
    _READ_INPUT: ReadInputRegistersRequest,
    _WRITE_ONE: WriteSingleRegisterRequest,
    _WRITE: WriteMultipleRegistersRequest,
    _READ_WRITE: ReadWriteMultipleRegistersRequest,
}
_MOST_READ, _MOST_WRITTEN = 125, 123
_LAST = 0xFFFF


class ExceptionCode(IntEnum):
    """Exception codes, in the words of the Modbus specification."""

    FUNCTION = 1
    ADDRESS = 2
    VALUE = 3
    FAILURE = 4
    NO_PATH = 10
    """Gateway path unavailable: no such unit, or a value that is not polled."""
    NO_RESPONSE = 11
    """Gateway target device failed to respond: the drive is silent, or its values are too old."""


class RefusedRequest(Exception):  # noqa: N818 - it is an answer, and not an error of ours
    """Request that gets an exception response."""

    def __init__(self, code: ExceptionCode) -> None:
        super().__init__(code.name)
        self.code = code


@dataclass(frozen=True, slots=True, kw_only=True)
class RegisterRequest:
    """Request. write_at, written: registers to write before the read; empty if nothing is written."""

    function: int
    read_at: int = 0
    read_count: int = 0
    write_at: int = 0
    written: tuple[int, ...] = ()


def parse_request(telegram: bytes) -> RegisterRequest:
    """Return the request in a telegram that starts with its function code. Raises RefusedRequest."""
    function = telegram[0]
    if function not in _REQUESTS:
        raise RefusedRequest(ExceptionCode.FUNCTION)
    request = _REQUESTS[function]()
    try:
        request.decode(telegram[1:])
        again = request.encode()
    except Exception:  # noqa: BLE001 - whatever a strange telegram does to the decoder
        raise RefusedRequest(ExceptionCode.VALUE) from None
    # pymodbus decodes more, and less, than the specification allows. A correct request equals its own encoding.
    if again != telegram[1:]:
        raise RefusedRequest(ExceptionCode.VALUE)
    asked = _asked(function, request)
    if len(asked.written) > _MOST_WRITTEN or asked.read_count > _MOST_READ:
        raise RefusedRequest(ExceptionCode.VALUE)
    for first, count in ((asked.read_at, asked.read_count), (asked.write_at, len(asked.written))):
        if first + count - 1 > _LAST:
            raise RefusedRequest(ExceptionCode.ADDRESS)
    return asked


def _asked(function: int, request: ModbusPDU) -> RegisterRequest:
    if isinstance(request, ReadWriteMultipleRegistersRequest):
        return RegisterRequest(
            function=function,
            read_at=request.read_address,
            read_count=request.read_count,
            write_at=request.write_address,
            written=tuple(request.write_registers),
        )
    if function in (_WRITE_ONE, _WRITE):
        if not request.registers:
            raise RefusedRequest(ExceptionCode.VALUE)
        return RegisterRequest(function=function, write_at=request.address, written=tuple(request.registers))
    return RegisterRequest(function=function, read_at=request.address, read_count=request.count)


def encode_response(asked: RegisterRequest, words: Sequence[int]) -> bytes:
    """Return the response to a request, starting with its function code. words: the registers read."""
    written: ModbusPDU | None = None
    if asked.function == _WRITE_ONE:
        written = WriteSingleRegisterResponse(address=asked.write_at, registers=asked.written)
    elif asked.function == _WRITE:
        written = WriteMultipleRegistersResponse(address=asked.write_at, count=len(asked.written))
    if written is not None:
        return bytes([asked.function]) + written.encode()
    # Much faster than pymodbus, which packs word by word.
    return struct.pack(f">BB{len(words)}H", asked.function, 2 * len(words), *words)


def encode_exception(telegram: bytes, code: ExceptionCode) -> bytes:
    """Return the exception response to a refused request."""
    # A function code that already has the exception bit is answered unchanged.
    refused = ExceptionResponse(telegram[0] & 0x7F, code)
    return bytes([refused.function_code]) + refused.encode()
