"""Readings told as findings: whom a telegram concerns, whether it expects a reply, whether it is guarded."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.traffic.sniffer.conversation import is_broadcast
from drivecomm.traffic.sniffer.heard import EVERYBODY, AmbiguousTelegram, HeardTelegram

if TYPE_CHECKING:
    from collections.abc import Iterable

    from drivecomm.protocol import Direction, Protocol
    from drivecomm.traffic.sniffer.conversation import Heard
    from drivecomm.traffic.sniffer.readings import Reading


def ways_of(readings: Iterable[Reading]) -> tuple[tuple[str, Direction, Any], ...]:
    """Return the readings as an ambiguous telegram lists them."""
    return tuple((reading.protocol.name, reading.direction, reading.message) for reading in readings)


def ambiguous_of(heard: Heard) -> AmbiguousTelegram:
    """Return the finding for what may have gone either way."""
    return AmbiguousTelegram(time_s=heard.ended_s, data=heard.readings[0].data, readings=ways_of(heard.readings))


def telegram_of(reading: Reading, heard: Heard) -> HeardTelegram:
    """Return the finding for what was read so."""
    protocol, message = reading.protocol, reading.message
    named = getattr(message, "address", None) is not None
    return HeardTelegram(
        time_s=heard.ended_s,
        began_s=heard.began_s,
        protocol=protocol.name,
        direction=reading.direction,
        drive=drive_named_in(protocol, message),
        data=reading.data,
        message=message,
        expects_reply=reading.direction == "request" and named and not is_broadcast(protocol, message),
        guarded=not reading.short and not protocol.blind_spots(reading.data, reading.direction),
    )


def drive_named_in(protocol: Protocol, message: Any) -> str:
    """Return whom a message concerns, as PROTOCOL:ADDRESS; the protocol alone where it names nobody."""
    if is_broadcast(protocol, message):
        return f"{protocol.name}:{EVERYBODY}"
    address = getattr(message, "address", None)
    return protocol.name if address is None else f"{protocol.name}:{address}"
