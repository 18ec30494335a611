"""The exchanges of a capture: the sender of each piece, each request with its reply, and the meaning of a request."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from drivecomm.errors import TelegramError, UsageError
from drivecomm.traffic.sniffer import AmbiguousTelegram, HeardTelegram, Sniffer

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from drivecomm.capture import Capture, Piece, Source
    from drivecomm.protocol import Direction, LineSettings, Message, Protocol
    from drivecomm.traffic.sniffer import TrafficItem


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplyPart:
    """Bytes of a reply that arrived together.

    after_s: seconds from the end of the request until the last of them arrived.
    """

    after_s: float
    data: bytes


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedExchange:
    """A request, and all bytes that arrived before the next one.

    asked_s: time at which the last byte of the request was sent. parts: parts of the reply, empty if there was none.
    settings: the line settings; None if unknown.
    """

    asked_s: float
    request: bytes
    parts: tuple[ReplyPart, ...] = ()
    line: str = ""
    settings: LineSettings | None = None

    @property
    def reply(self) -> bytes:
        """The whole reply; empty if there was none."""
        return b"".join(part.data for part in self.parts)

    @property
    def reply_s(self) -> float:
        """Seconds from the end of the request until the reply was complete; 0 if there was none."""
        return self.parts[-1].after_s if self.parts else 0.0


def recorded_exchanges(capture: Capture) -> list[RecordedExchange]:
    """Return the requests of a capture with their replies, in order; each of its lines is a separate conversation.

    Each piece of the master is one request. Pieces of drives before the first request of their line are left out, and
    so are pieces of unknown source. Raises UsageError if the source of every piece is unknown.
    """
    if capture.pieces and all(piece.source == "unknown" for piece in capture.pieces):
        raise UsageError("this capture does not say who sent what; infer the sources first")
    found: list[RecordedExchange] = []
    latest: dict[str, int] = {}
    for piece in capture.pieces:
        if piece.source == "master":
            latest[piece.line] = len(found)
            settings = piece.settings or capture.provenance.settings
            found.append(RecordedExchange(asked_s=piece.time_s, request=piece.data, line=piece.line, settings=settings))
        elif piece.source == "drive" and piece.line in latest:
            place = latest[piece.line]
            asked = found[place]
            part = ReplyPart(after_s=piece.time_s - asked.asked_s, data=piece.data)
            found[place] = replace(asked, parts=(*asked.parts, part))
    return found


def decoded_requests(request: bytes, protocols: Iterable[Protocol]) -> list[tuple[Protocol, Message]]:
    """Return the decoded request for each protocol in which these bytes are one request."""
    found = []
    for plugin in protocols:
        try:
            found.append((plugin, plugin.codec(plugin.options()).decode(request, "request")))
        except TelegramError:
            continue
    return found


def only_asks(request: bytes, protocols: Iterable[Protocol]) -> bool:
    """Whether these bytes neither command nor write in any protocol that decodes them as a request.

    False if no protocol decodes them, because such bytes could do anything.
    """
    found = decoded_requests(request, protocols)
    return bool(found) and all(plugin.intent and plugin.intent(message).only_asks for plugin, message in found)


def request_as_text(request: bytes, protocols: Iterable[Protocol]) -> str:
    """Return a request as text: its bytes, and its meaning in the first protocol that decodes it."""
    shown = request.hex(" ").upper()
    for plugin, message in decoded_requests(request, protocols):
        address = getattr(message, "address", None)
        return f"{shown} ({plugin.name}{'' if address is None else f':{address}'} {message.kind})"
    return shown


_SENDERS: dict[Direction, Source] = {"request": "master", "reply": "drive"}


def infer_sources(capture: Capture, protocols: Sequence[Protocol]) -> Capture:
    """Return the capture with its pieces of unknown source cut into telegrams of these protocols, each with its source.

    Pieces whose source is known stay as they are; bytes outside of telegrams keep an unknown source. If bytes read both
    as a request and as a reply, and the whole traffic does not decide, they are a reply if they fit the request before.
    """
    told = [piece for piece in capture.pieces if piece.source != "unknown"]
    for line in {piece.line for piece in capture.pieces}:
        unknown = [piece for piece in capture.pieces if piece.source == "unknown" and piece.line == line]
        sniffer = Sniffer(protocols, settings=capture.provenance.settings)
        items = [item for piece in unknown for item in sniffer.feed(piece)] + sniffer.finish()
        told += _told(unknown, items, {protocol.name: protocol for protocol in protocols})
    return replace(capture, pieces=sorted(told, key=lambda piece: piece.time_s))


def _told(pieces: Sequence[Piece], items: Sequence[TrafficItem], protocols: dict[str, Protocol]) -> Iterator[Piece]:
    # The sniffer reports every byte exactly once, in the order of the line.
    holders = [piece for piece in pieces for _ in piece.data]
    place = 0
    asked: tuple[str, Message, bytes] | None = None
    for item in items:
        ways: dict[Direction, tuple[str, Message]] = {}
        if isinstance(item, HeardTelegram):
            ways = {item.direction: (item.protocol, item.message)}
        elif isinstance(item, AmbiguousTelegram) and len(item.data) > 1:
            ways = {direction: (name, message) for name, direction, message in item.readings}
        source: Source = "unknown"
        if "reply" in ways and ("request" not in ways or _answers(ways["reply"], item.data, asked, protocols)):
            source, asked = "drive", None
        elif "request" in ways:
            source, asked = "master", (*ways["request"], item.data)
        first, place = holders[place], place + len(item.data)
        yield replace(first, time_s=holders[place - 1].time_s, data=item.data, source=source)


def _answers(
    reply: tuple[str, Message], data: bytes, asked: tuple[str, Message, bytes] | None, protocols: dict[str, Protocol]
) -> bool:
    if asked is None or asked[0] != reply[0] or asked[2] == data:
        return False
    return not protocols[reply[0]].mismatch(asked[1], reply[1])
