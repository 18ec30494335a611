"""Find out what is spoken on an unknown line: baud rate, character format, protocols. Only by listening.

At a wrong baud rate nothing that is heard is a telegram. At the right one, 8N1 hears characters of ten bits as they
are, those of 7E1 with their parity as an eighth bit, and 8E1 hears characters of eleven; which of the formats it really
is shows in the characters with a wrong parity or stop bit. One and two stop bits look the same to a receiver.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol as Interface

from drivecomm.protocol import USUAL_BAUD_RATES, LineSettings
from drivecomm.traffic.sniffer.readings import SHORTEST_LONG
from drivecomm.traffic.sniffer.sniffer import Sniffer
from drivecomm.traffic.sniffer.traffic_items import AmbiguousTelegram, HeardTelegram

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from drivecomm.capture import Piece
    from drivecomm.protocol import Parity, Protocol
    from drivecomm.traffic.sniffer.traffic_items import TrafficItem


_FORMATS: tuple[tuple[int, Parity], ...] = ((7, "E"), (7, "O"), (8, "E"), (8, "O"), (8, "N"))
"""Those that check most first: of equally good ones the first is meant."""
_TEN_BITS: tuple[int, Parity] = (8, "N")
_ELEVEN_BITS: tuple[int, Parity] = (8, "E")

_LOOK, _COMPARE, _LISTEN = 6, 9, 40
"""How many telegrams to wait for: to see whether there are any, to tell the formats apart, to hear all protocols."""
_ENOUGH = 2
# A wrong format spoils half of the characters, noise a few.
_CHANCE = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class LineSample:
    """What was received while listening. spoilt: how many of the characters had a wrong parity or stop bit."""

    pieces: Sequence[Piece]
    spoilt: int

    @property
    def characters(self) -> int:
        """How many characters came, spoilt ones included."""
        return sum(len(piece.data) for piece in self.pieces)


class Listening(Interface):
    """A line that can be listened to with any settings."""

    def listen(self, settings: LineSettings, telegrams: int) -> LineSample:
        """Listen until about so many telegrams, separated by silence, have passed; not forever if none come.

        Spoilt characters are heard all the same. Raises LinkError when the line is gone.
        """
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Detected:
    """What is spoken on a line.

    settings: with one stop bit, as two cannot be told from one. protocols: by name, the most frequent first. telegrams:
    how many sound ones were heard with these settings. understood: the share of the characters that belong to them.
    spoilt: the share of the characters whose parity or stop bit was wrong.
    """

    settings: LineSettings
    protocols: tuple[str, ...]
    telegrams: int
    understood: float
    spoilt: float


def detect(
    line: Listening, protocols: Iterable[Protocol], baud_rates: Sequence[int] = USUAL_BAUD_RATES
) -> Detected | None:
    """Return what is spoken on a line; None when nothing was understood with any settings."""
    known = list(protocols)
    for baudrate in baud_rates:
        if _is_right(line, known, baudrate):
            return _best(line, known, baudrate)
    return None


def _is_right(line: Listening, protocols: Sequence[Protocol], baudrate: int) -> bool:
    ten_bits, eleven_bits = _settings(baudrate, _TEN_BITS), _settings(baudrate, _ELEVEN_BITS)
    heard = line.listen(ten_bits, _LOOK)
    if _judge(heard, protocols, ten_bits) or _judge(_seven_bits(heard), protocols, ten_bits):
        return True
    return _judge(line.listen(eleven_bits, _LOOK), protocols, eleven_bits) is not None


def _seven_bits(heard: LineSample) -> LineSample:
    """Return the same characters without their parity bit, if that is what the eighth bit is."""
    pieces = [replace(piece, data=bytes(byte & 0x7F for byte in piece.data)) for piece in heard.pieces]
    return replace(heard, pieces=pieces)


def _best(line: Listening, protocols: Sequence[Protocol], baudrate: int) -> Detected | None:
    found = []
    for frame in _FORMATS:
        settings = _settings(baudrate, frame)
        if (judged := _judge(line.listen(settings, _COMPARE), protocols, settings)) is not None:
            found.append(judged)
    if not found:
        return None
    fewest = min(each.spoilt for each in found)
    best = next(each for each in found if each.spoilt <= fewest + _CHANCE)
    return _judge(line.listen(best.settings, _LISTEN), protocols, best.settings) or best


def _settings(baudrate: int, frame: tuple[int, Parity]) -> LineSettings:
    return LineSettings(baudrate=baudrate, bytesize=frame[0], parity=frame[1])


def _judge(heard: LineSample, protocols: Sequence[Protocol], settings: LineSettings) -> Detected | None:
    """Return what is understood with these settings; None when that is nothing, or could be chance."""
    sniffer = Sniffer(protocols, settings=settings)
    items = [item for piece in heard.pieces for item in sniffer.feed(replace(piece, settings=settings))]
    sound = [each for each in _sound([*items, *sniffer.finish()]) if len(each[1]) >= SHORTEST_LONG]
    if len(sound) < _ENOUGH:
        return None
    names = [name for name, _ in sound]
    return Detected(
        settings=settings,
        protocols=tuple(sorted(set(names), key=lambda name: (-names.count(name), name))),
        telegrams=len(sound),
        understood=sum(len(data) for _, data in sound) / heard.characters,
        spoilt=heard.spoilt / heard.characters,
    )


def _sound(items: Iterable[TrafficItem]) -> Iterator[tuple[str, bytes]]:
    """Yield protocol and bytes of each telegram; which way it went may be open."""
    for item in items:
        if isinstance(item, HeardTelegram):
            yield item.protocol, item.data
        elif isinstance(item, AmbiguousTelegram) and len({name for name, _, _ in item.readings}) == 1:
            yield item.readings[0][0], item.data
