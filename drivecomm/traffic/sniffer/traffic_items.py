"""What a listener makes of the bytes on a line: telegrams, damaged ones, ambiguous ones, and bytes that are none."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

from drivecomm.protocol import is_broadcast

if TYPE_CHECKING:
    from collections.abc import Iterable

    from drivecomm.errors import TelegramError
    from drivecomm.protocol import Direction, Message, Protocol
    from drivecomm.traffic.sniffer.directions import Observation
    from drivecomm.traffic.sniffer.readings import Reading

_made = tuple.__new__
EVERYBODY = "all"
"""Stands in place of the address in a broadcast."""


class HeardTelegram(NamedTuple):
    """A sound telegram.

    time_s: when its last character was there; began_s: when its first one began, as far as the pieces tell. drive: who
    is asked or answers, as PROTOCOL:ADDRESS; PROTOCOL:all for a broadcast, PROTOCOL where the telegram names nobody.
    expects_reply: False for replies, broadcasts and other telegrams that nobody answers. guarded: whether any single
    wrong bit would have been noticed; a VABus enquiry, say, has no check.
    """

    time_s: float
    began_s: float
    protocol: str
    direction: Direction
    drive: str
    data: bytes
    message: Message
    expects_reply: bool
    guarded: bool

    @property
    def broadcast(self) -> bool:
        """Whether it is for all drives."""
        return self.drive == f"{self.protocol}:{EVERYBODY}"


@dataclass(frozen=True, slots=True, kw_only=True)
class DamagedTelegram:
    """Bytes with the shape of a telegram that are none, on a line where this protocol is spoken.

    drive: the drive that was asked, where these bytes came when its reply was due; empty otherwise.
    """

    time_s: float
    protocol: str
    direction: Direction
    drive: str
    data: bytes
    error: TelegramError


@dataclass(frozen=True, slots=True, kw_only=True)
class AmbiguousTelegram:
    """Bytes that are a sound telegram in several ways, none of them more likely than the others.

    readings: each way, as protocol, direction and message; a single one where it is a single character that may as well
    be all that came of a longer request.
    """

    time_s: float
    data: bytes
    readings: tuple[tuple[str, Direction, Message], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class UnknownBytes:
    """Bytes that belong to no telegram of the protocols that are looked for."""

    time_s: float
    data: bytes


TrafficItem: TypeAlias = HeardTelegram | DamagedTelegram | AmbiguousTelegram | UnknownBytes
"""What the sniffer makes of bytes."""


def ways_of(readings: Iterable[Reading]) -> tuple[tuple[str, Direction, Any], ...]:
    """Return the readings as an ambiguous telegram lists them."""
    return tuple((reading.protocol.name, reading.direction, reading.message) for reading in readings)


def ambiguous_of(heard: Observation) -> AmbiguousTelegram:
    """Return the item for what may have gone either way."""
    return AmbiguousTelegram(time_s=heard.ended_s, data=heard.readings[0].data, readings=ways_of(heard.readings))


def telegram_of(reading: Reading, heard: Observation) -> HeardTelegram:
    """Return the item for what was read so."""
    protocol, message, data, direction = reading.protocol, reading.message, reading.data, reading.direction
    drive = drive_named_in(protocol, message)
    expects_reply = direction == "request" and ":" in drive and not drive.endswith(f":{EVERYBODY}")
    guarded = not reading.short and not protocol.blind_spots(data, direction)
    ended_s, began_s = heard.ended_s, heard.began_s
    return _made(
        HeardTelegram, (ended_s, began_s, protocol.name, direction, drive, data, message, expects_reply, guarded)
    )


def drive_named_in(protocol: Protocol, message: Any) -> str:
    """Return whom a message concerns, as PROTOCOL:ADDRESS; the protocol alone where it names nobody."""
    if is_broadcast(protocol, message):
        return f"{protocol.name}:{EVERYBODY}"
    address = getattr(message, "address", None)
    return protocol.name if address is None else f"{protocol.name}:{address}"
