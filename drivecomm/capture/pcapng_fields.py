"""Captures as pcapng, which Wireshark opens: section header, interface descriptions, enhanced packet blocks.

The format is IETF draft-ietf-opsawg-pcapng. The link type is LINKTYPE_RTAC_SERIAL (250): the only registered type for
bytes of a serial line with their sender; Wireshark has a dissector for it. Each packet is

    seconds (4)  microseconds (4)  event (1)  control lines (1)  reserved (2)  bytes from the line

with numbers in network byte order; the time repeats that of the packet block. Event 1 is "transmit", 2 is "receive".

The provenance is a comment of the section header. Each line, and each set of line settings on it, is an interface.
Bytes from an unknown sender have packet flags without a direction.
"""

from __future__ import annotations

import struct
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from drivecomm.capture.pieces import Source

# Block types
SECTION, INTERFACE, SIMPLE_PACKET, PACKET = 0x0A0D0D0A, 1, 3, 6
MAGIC = b"\x0a\x0d\x0d\x0a"
"""First bytes of a file, the same in either byte order."""
BYTE_ORDER = 0x1A2B3C4D
RTAC_SERIAL = 250

# Option codes: of every block, of a section, of an interface, of a packet
END, COMMENT = 0, 1
USER_APPLICATION = 4
NAME, DESCRIPTION, SPEED, RESOLUTION, OFFSET = 2, 3, 8, 9, 14
FLAGS = 2

RTAC_HEADER = struct.Struct(">IIBBH")
DIRECTIONS: dict[Source, int] = {"unknown": 0, "drive": 1, "master": 2}
"""Direction in the packet flags for each source: none, inbound, outbound."""

SECOND_NS = 1_000_000_000
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
LATEST = datetime(2400, 1, 1, tzinfo=UTC)
"""Latest start of a capture: 64 bits of nanoseconds last until 2554, and a capture may be long."""


def nanoseconds(time: datetime) -> int:
    """Return a time as nanoseconds since 1970."""
    # In integers: a float lacks the digits for a present time in nanoseconds.
    return (time - EPOCH) // timedelta(microseconds=1) * 1000
