"""Items decoded from a line: telegrams, damaged telegrams, ambiguous telegrams, and unknown bytes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

from drivecomm.protocol import is_broadcast

if TYPE_CHECKING:
    from collections.abc import Iterable

    from drivecomm.errors import TelegramError
    from drivecomm.protocol import Direction, Message, Protocol
    from drivecomm.traffic.sniffer.directions import Observation
    from drivecomm.traffic.sniffer.readings import TelegramReading

_made = tuple.__new__
EVERYBODY = "all"
"""Replacement for the address in a broadcast."""


class HeardTelegram(NamedTuple):
    """A sound telegram.

    time_s: end of its last character. began_s: start of its first character, as precisely as the pieces show. drive:
    the drive that is addressed or that answers, as PROTOCOL:ADDRESS; PROTOCOL:all for a broadcast, PROTOCOL if the
    telegram names no drive. expects_reply: False for replies, broadcasts and other telegrams without a reply. guarded:
    whether any single wrong bit would have been detected; a VABus enquiry, for example, has no check.
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
        """Whether the telegram is for all drives."""
        return self.drive == f"{self.protocol}:{EVERYBODY}"


@dataclass(frozen=True, slots=True, kw_only=True)
class DamagedTelegram:
    """Bytes with the shape of a telegram that do not decode, in a protocol that is spoken on the line.

    drive: the drive whose reply was due when these bytes came; empty if no reply was due.
    """

    time_s: float
    protocol: str
    direction: Direction
    drive: str
    data: bytes
    error: TelegramError


@dataclass(frozen=True, slots=True, kw_only=True)
class AmbiguousTelegram:
    """Bytes with several sound readings, none of them more likely than the others.

    readings: each as protocol, direction and message. There is only one if a single character may also be the rest of a
    longer request.
    """

    time_s: float
    data: bytes
    readings: tuple[tuple[str, Direction, Message], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class UnknownBytes:
    """Bytes that belong to no telegram of the protocols looked for."""

    time_s: float
    data: bytes


TrafficItem: TypeAlias = HeardTelegram | DamagedTelegram | AmbiguousTelegram | UnknownBytes
"""An item that the sniffer reports."""


def ways_of(readings: Iterable[TelegramReading]) -> tuple[tuple[str, Direction, Any], ...]:
    """Return the readings in the form in which an ambiguous telegram lists them."""
    return tuple((reading.protocol.name, reading.direction, reading.message) for reading in readings)


def ambiguous_of(heard: Observation) -> AmbiguousTelegram:
    """Return the item for a telegram whose direction is open."""
    return AmbiguousTelegram(time_s=heard.ended_s, data=heard.readings[0].data, readings=ways_of(heard.readings))


def telegram_of(reading: TelegramReading, heard: Observation) -> HeardTelegram:
    """Return the item for a telegram with this reading."""
    protocol, message, data, direction = reading.protocol, reading.message, reading.data, reading.direction
    drive = drive_named_in(protocol, message)
    expects_reply = direction == "request" and ":" in drive and not drive.endswith(f":{EVERYBODY}")
    guarded = not reading.short and not protocol.blind_spots(data, direction)
    ended_s, began_s = heard.ended_s, heard.began_s
    return _made(
        HeardTelegram, (ended_s, began_s, protocol.name, direction, drive, data, message, expects_reply, guarded)
    )


def drive_named_in(protocol: Protocol, message: Any) -> str:
    """Return the drive that a message concerns, as PROTOCOL:ADDRESS; the protocol alone if it names no drive."""
    if is_broadcast(protocol, message):
        return f"{protocol.name}:{EVERYBODY}"
    address = getattr(message, "address", None)
    return protocol.name if address is None else f"{protocol.name}:{address}"
