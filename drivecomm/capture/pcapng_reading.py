"""Reading of pcapng captures, our own and foreign ones; `drivecomm.capture.pcapng_fields` describes the format."""

from __future__ import annotations

import json
import re
import struct
from dataclasses import dataclass
from datetime import timedelta
from itertools import chain, islice
from typing import TYPE_CHECKING, Literal, TypeAlias, cast

from drivecomm.capture import pcapng_fields as pcapng
from drivecomm.capture.json_lines import is_header, provenance_of
from drivecomm.capture.pieces import LONGEST_S, Piece, Provenance, Source
from drivecomm.errors import FileFormatError, UsageError
from drivecomm.protocol import LineSettings, Parity

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path
    from typing import BinaryIO

# Events of the link type: transmitting and receiving, each begun or ended.
_SENT_IN: dict[int, Source] = {1: "master", 3: "master", 2: "drive", 4: "drive"}
_SENT_TOWARDS: dict[int, Source] = {number: source for source, number in pcapng.DIRECTIONS.items()}

# Wireshark refuses larger blocks as well; a greater length indicates a damaged file.
_LONGEST_BLOCK = 16 * 1024 * 1024
_MICROSECONDS = 6
_FORMAT_WORDS = re.compile(r"(\d+) ([78])([NEOMS])(1|1\.5|2)(?: |$)")

Order: TypeAlias = Literal["<", ">"]


@dataclass(slots=True, kw_only=True)
class _Interface:
    """Interface description in a file. units: clock units per second."""

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


class PcapngReader:
    """Reader of a pcapng file of any program, block by block. The file must begin with `MAGIC`.

    A file may have several sections, each with its own byte order and interfaces. ahead: number of packets to read
    ahead for the start of the capture if the file does not contain it; None for all. remarks: sentences about skipped
    content, complete after the last piece. Raises FileFormatError with the file and the position of the error.
    """

    def __init__(self, path: Path, file: BinaryIO, ahead: int | None) -> None:
        self._path = path
        self._file = file
        self._order: Order = "<"
        self._interfaces: list[_Interface] = []
        self._foreign: dict[int, int] = {}
        self._timeless = 0
        self._about: Provenance | None = None
        self._tool = ""
        self._comments: list[str] = []
        self._sections = 0
        self.remarks: list[str] = []
        self._packets = self._all_packets()
        self._first = list(islice(self._packets, ahead))
        self._began_ns = self._first_ns()
        self.provenance = self._about or self._made_provenance()

    def pieces(self) -> Iterator[Piece]:
        """Yield the pieces in the order of the file; callable once only."""
        for packet in chain(self._first, self._packets):
            if packet.time_ns < self._began_ns:
                raise FileFormatError(f"{self._path}: the first packet is older than the capture")
            yield Piece(
                time_s=(packet.time_ns - self._began_ns) / pcapng.SECOND_NS,
                data=packet.data,
                source=packet.source,
                line=packet.interface.line,
                settings=packet.interface.settings,
            )
        if self._foreign and not self._first:
            kinds = ", ".join(map(str, sorted(self._foreign)))
            raise FileFormatError(
                f"{self._path}: not captured on a serial line (link type {kinds}); "
                f"the supported link type is {pcapng.RTAC_SERIAL}"
            )
        self.remarks += [
            f"{self._path}: {count} packets of link type {kind} are left out" for kind, count in self._foreign.items()
        ]
        if self._timeless:
            self.remarks.append(f"{self._path}: {self._timeless} packets without a time are left out")

    def _all_packets(self) -> Iterator[_Packet]:
        place = 0
        while head := self._file.read(12):
            try:
                block = self._block(head)
                packet = block and self._packet_in(block)
            except (FileFormatError, struct.error, UnicodeDecodeError) as error:
                raise FileFormatError(f"{self._path}: block at byte {place}: {error}") from error
            if not block:
                if not self._sections:
                    raise FileFormatError(f"{self._path}: the file ends in the middle of the header")
                self.remarks.append(f"{self._path}: the block at byte {place} is cut off and left out")
                return
            if packet:
                yield packet
            place += len(block)

    def _first_ns(self) -> int:
        if self._about is None:
            # Whole microseconds, because a datetime cannot hold less.
            return min(packet.time_ns for packet in self._first) // 1000 * 1000 if self._first else 0
        return 0 if self._about.began is None else pcapng.nanoseconds(self._about.began)

    def _made_provenance(self) -> Provenance:
        began = pcapng.EPOCH + timedelta(microseconds=self._began_ns // 1000) if self._first else None
        return Provenance(began=began, tool=self._tool, note="\n".join(self._comments))

    def _block(self, head: bytes) -> bytes:
        """Return the whole block that begins with these 12 bytes, b"" if it is incomplete."""
        if len(head) < 12:
            return b""
        if head.startswith(pcapng.MAGIC):
            self._order = _byte_order(head[8:12])
        _, length = struct.unpack_from(f"{self._order}II", head)
        if length < 12 or length % 4 or length > _LONGEST_BLOCK:
            raise FileFormatError(f"invalid length {length}")
        block = head + self._file.read(length - 12)
        if len(block) < length:
            return b""
        (again,) = struct.unpack_from(f"{self._order}I", block, length - 4)
        if again != length:
            raise FileFormatError(f"the length is {length} at the beginning and {again} at the end")
        return block

    def _packet_in(self, block: bytes) -> _Packet | None:
        """Process a block; return its packet, None for another kind of block."""
        (kind,) = struct.unpack_from(f"{self._order}I", block)
        body = block[8:-4]
        if kind == pcapng.PACKET:
            return self._packet(body)
        if kind == pcapng.SECTION:
            self._section(body)
        elif kind == pcapng.INTERFACE:
            self._interface(body)
        elif kind == pcapng.SIMPLE_PACKET:
            self._timeless += 1
        return None

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

    def _packet(self, body: bytes) -> _Packet | None:
        number, high, low, length, _ = struct.unpack_from(f"{self._order}IIIII", body)
        if number >= len(self._interfaces):
            raise FileFormatError(f"interface {number} is used before its description")
        if 20 + length > len(body):
            raise FileFormatError(f"a packet of {length} bytes does not fit into the block")
        interface = self._interfaces[number]
        if interface.link_type != pcapng.RTAC_SERIAL:
            self._foreign[interface.link_type] = self._foreign.get(interface.link_type, 0) + 1
            return None
        if length < pcapng.RTAC_HEADER.size:
            raise FileFormatError(f"a packet of {length} bytes is too short for its link type")
        event = body[20 + 8]
        data = body[20 + pcapng.RTAC_HEADER.size : 20 + length]
        if not data:
            # A change of the line's state without bytes.
            return None
        source = _SENT_IN.get(event, "unknown")
        for code, value in self._options(body, 20 + length + -length % 4):
            if code == pcapng.FLAGS:
                (flags,) = struct.unpack(f"{self._order}I", value)
                source = _SENT_TOWARDS.get(flags & 3, "unknown")
        time_ns = (high << 32 | low) * pcapng.SECOND_NS // interface.units + interface.offset_s * pcapng.SECOND_NS
        if not 0 <= time_ns <= pcapng.nanoseconds(pcapng.LATEST) + LONGEST_S * pcapng.SECOND_NS:
            raise FileFormatError("the time is not between 1970 and 2495")
        return _Packet(time_ns=time_ns, data=data, source=source, interface=interface)

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
    """Return the line settings in an interface description, None unless this program has written it."""
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
