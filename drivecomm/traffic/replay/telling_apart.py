"""Who sent what in a capture that does not say it, as that of a tap: what the sniffer hears, piece by piece."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from drivecomm.traffic.sniffer import AmbiguousTelegram, HeardTelegram, Sniffer

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from drivecomm.capture import Capture, Piece, Source
    from drivecomm.protocol import Direction, Message, Protocol
    from drivecomm.traffic.sniffer import Finding

_SENDERS: dict[Direction, Source] = {"request": "master", "reply": "drive"}


def telling_apart(capture: Capture, protocols: Sequence[Protocol]) -> Capture:
    """Return the capture with its unknown pieces cut into telegrams of these protocols, each with its source.

    Pieces whose source is known stay as they are; bytes that are no telegram stay unknown. What reads as a request and
    as a reply, even for who has heard all of it, is a reply where it fits the request before it.
    """
    told = [piece for piece in capture.pieces if piece.source != "unknown"]
    for line in {piece.line for piece in capture.pieces}:
        unknown = [piece for piece in capture.pieces if piece.source == "unknown" and piece.line == line]
        sniffer = Sniffer(protocols, settings=capture.provenance.settings)
        findings = [finding for piece in unknown for finding in sniffer.feed(piece)] + sniffer.finish()
        told += _told(unknown, findings, {protocol.name: protocol for protocol in protocols})
    return replace(capture, pieces=sorted(told, key=lambda piece: piece.time_s))


def _told(pieces: Sequence[Piece], findings: Sequence[Finding], protocols: dict[str, Protocol]) -> Iterator[Piece]:
    # The sniffer reports every byte once, in the order of the line.
    holders = [piece for piece in pieces for _ in piece.data]
    place = 0
    asked: tuple[str, Message, bytes] | None = None
    for finding in findings:
        ways: dict[Direction, tuple[str, Message]] = {}
        if isinstance(finding, HeardTelegram):
            ways = {finding.direction: (finding.protocol, finding.message)}
        elif isinstance(finding, AmbiguousTelegram) and len(finding.data) > 1:
            ways = {direction: (name, message) for name, direction, message in finding.readings}
        source: Source = "unknown"
        if "reply" in ways and ("request" not in ways or _answers(ways["reply"], finding.data, asked, protocols)):
            source, asked = "drive", None
        elif "request" in ways:
            source, asked = "master", (*ways["request"], finding.data)
        first, place = holders[place], place + len(finding.data)
        yield replace(first, time_s=holders[place - 1].time_s, data=finding.data, source=source)


def _answers(
    reply: tuple[str, Message], data: bytes, asked: tuple[str, Message, bytes] | None, protocols: dict[str, Protocol]
) -> bool:
    if asked is None or asked[0] != reply[0] or asked[2] == data:
        return False
    return not protocols[reply[0]].mismatch(asked[1], reply[1])
