"""Writing of pcapng captures, block by block; `drivecomm.capture.pcapng_fields` describes the format."""

from __future__ import annotations

import json
import struct
from typing import TYPE_CHECKING

from drivecomm.capture import pcapng_fields as pcapng
from drivecomm.capture.json_lines import header_of
from drivecomm.errors import UsageError

if TYPE_CHECKING:
    from drivecomm.capture.pieces import Piece, Provenance, Source
    from drivecomm.protocol import LineSettings

_TRANSMIT, _RECEIVE = 1, 2
# For a listener, all traffic is received.
_EVENTS: dict[Source, int] = {"master": _TRANSMIT, "drive": _RECEIVE, "unknown": _RECEIVE}
_NANOSECONDS = 9
_LONGEST_OPTION = 0xFFFF


class Pcapng:
    """Encoder of a capture as pcapng."""

    def __init__(self, provenance: Provenance) -> None:
        self._provenance = provenance
        if provenance.began is not None and not pcapng.EPOCH <= provenance.began <= pcapng.LATEST:
            raise UsageError(f"pcapng cannot store a capture of the year {provenance.began:%Y}; write a .jsonl file")
        self._began_ns = 0 if provenance.began is None else pcapng.nanoseconds(provenance.began)
        self._interfaces: dict[tuple[str, LineSettings | None], int] = {}
        self._written = 0

    def opening(self) -> bytes:
        """Return the section header."""
        about = json.dumps(header_of(self._provenance), ensure_ascii=False)
        options = _option(pcapng.COMMENT, about.encode())
        if self._provenance.tool:
            options += _option(pcapng.USER_APPLICATION, self._provenance.tool.encode())
        # The section length is unknown while the file grows.
        return _block(pcapng.SECTION, struct.pack("<IHHq", pcapng.BYTE_ORDER, 1, 0, -1) + options + _option(pcapng.END))

    def piece(self, piece: Piece) -> bytes:
        """Return the packet of a piece, preceded by its interface description if it is the first piece on it."""
        before, place = b"", (piece.line, piece.settings)
        self._written = len(self._interfaces)
        if place not in self._interfaces:
            before = self._interface(piece.line, piece.settings)
            self._interfaces[place] = len(self._interfaces)
        time_ns = self._began_ns + round(piece.time_s * pcapng.SECOND_NS)
        seconds, rest_ns = divmod(time_ns, pcapng.SECOND_NS)
        # The seconds in the packet overflow in 2106; the time of the block does not.
        data = pcapng.RTAC_HEADER.pack(seconds & 0xFFFFFFFF, rest_ns // 1000, _EVENTS[piece.source], 0, 0) + piece.data
        head = struct.pack("<IIIII", self._interfaces[place], time_ns >> 32, time_ns & 0xFFFFFFFF, len(data), len(data))
        flags = _option(pcapng.FLAGS, struct.pack("<I", pcapng.DIRECTIONS[piece.source]))
        return before + _block(pcapng.PACKET, head + _padded(data) + flags + _option(pcapng.END))

    def take_back(self) -> None:
        """Undo the last piece, which did not reach the file, and its interface if the piece was the first on it."""
        while len(self._interfaces) > self._written:
            self._interfaces.popitem()

    def _interface(self, line: str, settings: LineSettings | None) -> bytes:
        known = settings or self._provenance.settings
        words = " at ".join(part for part in (str(known) if known else "", self._provenance.port) if part)
        options = _option(pcapng.NAME, line.encode()) if line else b""
        options += _option(pcapng.DESCRIPTION, words.encode()) if words else b""
        # An interface without speed has the line settings of the capture.
        options += _option(pcapng.SPEED, struct.pack("<Q", settings.baudrate)) if settings is not None else b""
        options += _option(pcapng.RESOLUTION, bytes([_NANOSECONDS])) + _option(pcapng.END)
        return _block(pcapng.INTERFACE, struct.pack("<HHI", pcapng.RTAC_SERIAL, 0, 0) + options)


def _block(kind: int, body: bytes) -> bytes:
    length = struct.pack("<I", 12 + len(body))
    return struct.pack("<I", kind) + length + body + length


def _option(code: int, value: bytes = b"") -> bytes:
    if len(value) > _LONGEST_OPTION:
        raise UsageError(f"a text of {len(value)} bytes is too long for a pcapng file; it has room for 65535")
    return struct.pack("<HH", code, len(value)) + _padded(value)


def _padded(data: bytes) -> bytes:
    return data + bytes(-len(data) % 4)
