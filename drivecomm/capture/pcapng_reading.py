"""Captures read from pcapng files, ours and those of others; `drivecomm.capture.pcapng_fields` says how they look."""

from __future__ import annotations

import json
import re
import struct
from dataclasses import dataclass, field
from datetime import timedelta
from typing import TYPE_CHECKING, Literal, TypeAlias, cast

from drivecomm.capture import pcapng_fields as pcapng
from drivecomm.capture.json_lines import is_header, provenance_of
from drivecomm.capture.pieces import LONGEST_S, Capture, Piece, Provenance, Source
from drivecomm.errors import FileFormatError, UsageError
from drivecomm.protocol import LineSettings, Parity

if TYPE_CHECKING:
    from pathlib import Path

# Events of the link type: transmitting and receiving, each begun or ended.
_SENT_IN: dict[int, Source] = {1: "master", 3: "master", 2: "drive", 4: "drive"}
_SENT_TOWARDS: dict[int, Source] = {number: source for source, number in pcapng.DIRECTIONS.items()}

# Wireshark refuses larger ones, too; a length beyond it is a damaged file, and not a long packet.
_LONGEST_BLOCK = 16 * 1024 * 1024
_MICROSECONDS = 6
_FORMAT_WORDS = re.compile(r"(\d+) ([78])([NEOMS])(1|1\.5|2)(?: |$)")

Order: TypeAlias = Literal["<", ">"]


def read_pcapng(path: Path, content: bytes) -> Capture:
    """Return the capture that these blocks hold, of this program or another; they begin with `MAGIC`.

    Raises FileFormatError with the file, and where in it something is wrong.
    """
    reader = _Reader(path)
    reader.read(content)
    return reader.capture()


@dataclass(slots=True, kw_only=True)
class _Interface:
    """What a file says of a line. units: how many units of its clock a second has."""

    link_type: int
    line: str
    settings: LineSettings | None
    units: int
    offset_s: int


@dataclass(slots=True, kw_only=True)
class _Packet:
    time_ns: int
    data: bytes
    source: Source
    interface: _Interface


@dataclass(slots=True)
class _Reader:
    """Takes a file apart; a file may have several sections, each with its byte order and its interfaces."""

    path: Path
    _order: Order = "<"
    _interfaces: list[_Interface] = field(default_factory=list)
    _packets: list[_Packet] = field(default_factory=list)
    _foreign: dict[int, int] = field(default_factory=dict)
    _timeless: int = 0
    _remarks: list[str] = field(default_factory=list)
    _about: Provenance | None = None
    _tool: str = ""
    _comments: list[str] = field(default_factory=list)
    _sections: int = 0

    def read(self, content: bytes) -> None:
        """Take it apart, block by block."""
        place = 0
        while place < len(content):
            try:
                length = self._block_at(content, place)
            except (FileFormatError, struct.error, UnicodeDecodeError) as error:
                raise FileFormatError(f"{self.path}: block at byte {place}: {error}") from error
            if not length:
                if not self._sections:
                    raise FileFormatError(f"{self.path}: the file ends in the middle of the header")
                self._remarks.append(f"{self.path}: the block at byte {place} is cut off and left out")
                return
            place += length

    def capture(self) -> Capture:
        """Return what was in it."""
        if self._foreign and not self._packets:
            kinds = ", ".join(map(str, sorted(self._foreign)))
            raise FileFormatError(
                f"{self.path}: not captured on a serial line (link type {kinds}); "
                f"the supported link type is {pcapng.RTAC_SERIAL}"
            )
        self._remarks += [
            f"{self.path}: {count} packets of link type {kind} are left out" for kind, count in self._foreign.items()
        ]
        if self._timeless:
            self._remarks.append(f"{self.path}: {self._timeless} packets without a time are left out")
        packets = sorted(self._packets, key=lambda packet: packet.time_ns)
        began_ns = self._began_ns(packets)
        return Capture(
            provenance=self._about or self._provenance(began_ns),
            pieces=[
                Piece(
                    time_s=(packet.time_ns - began_ns) / pcapng.SECOND_NS,
                    data=packet.data,
                    source=packet.source,
                    line=packet.interface.line,
                    settings=packet.interface.settings,
                )
                for packet in packets
            ],
            remarks=tuple(self._remarks),
        )

    def _began_ns(self, packets: list[_Packet]) -> int:
        if self._about is None:
            # Whole microseconds, as a time of day has them.
            return packets[0].time_ns // 1000 * 1000 if packets else 0
        began_ns = 0 if self._about.began is None else pcapng.nanoseconds(self._about.began)
        if packets and packets[0].time_ns < began_ns:
            raise FileFormatError(f"{self.path}: the first packet is older than the capture")
        return began_ns

    def _provenance(self, began_ns: int) -> Provenance:
        began = pcapng.EPOCH + timedelta(microseconds=began_ns // 1000) if self._packets else None
        return Provenance(began=began, tool=self._tool, note="\n".join(self._comments))

    def _block_at(self, content: bytes, place: int) -> int:
        """Read one block and return its length, 0 when it is cut off."""
        left = len(content) - place
        if left < 12:
            return 0
        if content[place : place + 4] == pcapng.MAGIC:
            self._order = _byte_order(content[place + 8 : place + 12])
        kind, length = struct.unpack_from(f"{self._order}II", content, place)
        if length < 12 or length % 4 or length > _LONGEST_BLOCK:
            raise FileFormatError(f"invalid length {length}")
        if left < length:
            return 0
        (again,) = struct.unpack_from(f"{self._order}I", content, place + length - 4)
        if again != length:
            raise FileFormatError(f"the length is {length} at the beginning and {again} at the end")
        body = content[place + 8 : place + length - 4]
        if kind == pcapng.SECTION:
            self._section(body)
        elif kind == pcapng.INTERFACE:
            self._interface(body)
        elif kind == pcapng.PACKET:
            self._packet(body)
        elif kind == pcapng.SIMPLE_PACKET:
            self._timeless += 1
        return int(length)

    def _section(self, body: bytes) -> None:
        major, minor = struct.unpack_from(f"{self._order}HH", body, 4)
        if major != 1:
            raise FileFormatError(f"version {major}.{minor} of pcapng is not supported, only 1 is")
        self._interfaces = []
        self._sections += 1
        for code, value in self._options(body, 16):
            if code == pcapng.USER_APPLICATION and self._sections == 1:
                self._tool = value.decode()
            elif code == pcapng.COMMENT:
                self._comment(value.decode())

    def _comment(self, comment: str) -> None:
        try:
            header = json.loads(comment)
        except (ValueError, RecursionError):
            header = None
        if not is_header(header):
            self._comments.append(comment)
        elif self._about is None:
            self._about = provenance_of(header)

    def _interface(self, body: bytes) -> None:
        (link_type,) = struct.unpack_from(f"{self._order}H", body)
        found = _Interface(link_type=link_type, line="", settings=None, units=10**_MICROSECONDS, offset_s=0)
        baudrate, words = 0, ""
        for code, value in self._options(body, 8):
            if code == pcapng.NAME:
                found.line = value.decode()
            elif code == pcapng.DESCRIPTION:
                words = value.decode()
            elif code == pcapng.SPEED:
                (baudrate,) = struct.unpack(f"{self._order}Q", value)
            elif code == pcapng.RESOLUTION:
                (resolution,) = struct.unpack("B", value)
                found.units = 2 ** (resolution & 0x7F) if resolution & 0x80 else 10**resolution
            elif code == pcapng.OFFSET:
                (found.offset_s,) = struct.unpack(f"{self._order}q", value)
        found.settings = _settings(baudrate, words)
        self._interfaces.append(found)

    def _packet(self, body: bytes) -> None:
        number, high, low, length, _ = struct.unpack_from(f"{self._order}IIIII", body)
        if number >= len(self._interfaces):
            raise FileFormatError(f"interface {number} is used before its description")
        if 20 + length > len(body):
            raise FileFormatError(f"a packet of {length} bytes does not fit into the block")
        interface = self._interfaces[number]
        if interface.link_type != pcapng.RTAC_SERIAL:
            self._foreign[interface.link_type] = self._foreign.get(interface.link_type, 0) + 1
            return
        if length < pcapng.RTAC_HEADER.size:
            raise FileFormatError(f"a packet of {length} bytes is too short for its link type")
        event = body[20 + 8]
        data = body[20 + pcapng.RTAC_HEADER.size : 20 + length]
        if not data:
            # The line's state changed, and no byte came.
            return
        source = _SENT_IN.get(event, "unknown")
        for code, value in self._options(body, 20 + length + -length % 4):
            if code == pcapng.FLAGS:
                (flags,) = struct.unpack(f"{self._order}I", value)
                source = _SENT_TOWARDS.get(flags & 3, "unknown")
        time_ns = (high << 32 | low) * pcapng.SECOND_NS // interface.units + interface.offset_s * pcapng.SECOND_NS
        if not 0 <= time_ns <= pcapng.nanoseconds(pcapng.LATEST) + LONGEST_S * pcapng.SECOND_NS:
            raise FileFormatError("the time is not between 1970 and 2495")
        self._packets.append(_Packet(time_ns=time_ns, data=data, source=source, interface=interface))

    def _options(self, body: bytes, place: int) -> list[tuple[int, bytes]]:
        found = []
        while place + 4 <= len(body):
            code, length = struct.unpack_from(f"{self._order}HH", body, place)
            if code == pcapng.END:
                break
            if place + 4 + length > len(body):
                raise FileFormatError(f"option {code} is longer than the block")
            found.append((code, body[place + 4 : place + 4 + length]))
            place += 4 + length + -length % 4
        return found


def _byte_order(mark: bytes) -> Order:
    for order in ("<", ">"):
        if mark == struct.pack(f"{order}I", pcapng.BYTE_ORDER):
            return order
    raise FileFormatError("invalid byte-order mark")


def _settings(baudrate: int, words: str) -> LineSettings | None:
    """Return what an interface says of its line; only ours say all of it."""
    given = _FORMAT_WORDS.match(words)
    if not given or int(given[1]) != baudrate:
        return None
    stopbits = float(given[4])
    try:
        return LineSettings(
            baudrate=baudrate,
            bytesize=int(given[2]),
            parity=cast("Parity", given[3]),
            stopbits=int(stopbits) if stopbits.is_integer() else stopbits,
        )
    except UsageError as error:
        raise FileFormatError(str(error)) from error
