"""Telegrams of one read, recorded from the framework itself, and the shortest cycle that physics allows."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from lines import EmulatedLine

import drivecomm
from drivecomm.virtual import VirtualLine, virtual_drive

if TYPE_CHECKING:
    from collections.abc import Mapping

READS = {"vabus": "481", "danfoss-fc": "16-13", "vlt3500": "215", "fuji": "M09"}
"""A parameter to read for each protocol."""

DELAY_S = 0.002
"""Reply delay of an emulated drive in seconds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Conversation:
    """Telegrams of one read. closing: sent after the reply and never answered; empty if there is none.

    pause_s: pause that the drive requires between a reply and the next request. options: line facts that the drive is
    opened with, in addition to the baud rate.
    """

    protocol: str
    parameter: str
    baudrate: int
    bits: float
    request: bytes
    reply: bytes
    closing: bytes = b""
    pause_s: float = 0.0
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def character_s(self) -> float:
        """Duration of one character in seconds."""
        return self.bits / self.baudrate

    @property
    def rest_s(self) -> float:
        """Shortest time from the end of a reply to the next request: the pause and the closing telegram."""
        return self.pause_s + len(self.closing) * self.character_s

    def cycle_s(self, delay_s: float = DELAY_S) -> float:
        """Shortest time from one read to the next."""
        return (len(self.request) + len(self.reply)) * self.character_s + delay_s + self.rest_s

    def without_pause(self) -> Conversation:
        """Return the same conversation for a master that keeps no pause."""
        return replace(self, pause_s=0.0)

    def line(self, *, spread_s: float = 0.0, whole: bool = False) -> EmulatedLine:
        """Return an emulated line with a drive that answers this conversation."""
        answers = {self.request: self.reply}
        if self.closing:
            answers[self.closing] = b""
        delays = (DELAY_S - spread_s, DELAY_S + spread_s)
        return EmulatedLine(bits=self.bits, baudrate=self.baudrate, delay_s=delays, answers=answers, whole=whole)


def record_conversation(protocol: str, baudrate: int, **options: Any) -> Conversation:
    """Read twice from a virtual drive, and return the recorded telegrams."""
    parameter = READS[protocol]
    events: list[drivecomm.TraceEvent] = []
    line = VirtualLine([virtual_drive(protocol, 1, baudrate=baudrate)])
    with drivecomm.open_bus(line.port, baudrate=baudrate, trace=events.append, **options) as bus:
        drive = bus.drive(protocol, 1)
        drive.read(parameter)
        drive.read(parameter)
        facts = drive.facts
    spoken = [(event.what, event.data) for event in events if event.what in ("sent", "received")]
    request, (_, reply) = spoken[0][1], spoken[1]
    closing = b"".join(data for _, data in spoken[2 : spoken.index(("sent", request), 1)])
    return Conversation(
        protocol=protocol,
        parameter=parameter,
        baudrate=baudrate,
        bits=round(facts.settings.character_s * baudrate, 1),
        request=request,
        reply=reply,
        closing=closing,
        pause_s=facts.turnaround_s,
        options=options,
    )
