"""Detection of the baud rate, character format and protocols of an unknown line, by listening only.

At a wrong baud rate no telegram can be decoded. At the right one, 8N1 receives characters of ten bits unchanged, and
those of 7E1 with their parity as an eighth bit; 8E1 receives characters of eleven bits. The number of characters with a
wrong parity or stop bit shows which format is right. One and two stop bits look the same to a receiver.
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
"""Character formats, the strictest first; of several that fit equally well, the first is chosen."""
_TEN_BITS: tuple[int, Parity] = (8, "N")
_ELEVEN_BITS: tuple[int, Parity] = (8, "E")

_LOOK, _COMPARE, _LISTEN = 6, 9, 40
"""Number of telegrams to wait for: to detect any, to compare the formats, and to hear all protocols."""
_ENOUGH = 2
# A wrong format spoils half of the characters, noise only a few.
_CHANCE = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class LineSample:
    """Bytes received while listening. spoilt: number of characters with a wrong parity or stop bit."""

    pieces: Sequence[Piece]
    spoilt: int

    @property
    def characters(self) -> int:
        """Number of received characters, spoilt ones included."""
        return sum(len(piece.data) for piece in self.pieces)


class ListeningLine(Interface):
    """A line that can be listened to with any line settings."""

    def listen(self, settings: LineSettings, telegrams: int) -> LineSample:
        """Listen until about this many telegrams, separated by silence, have passed, or until a time limit.

        The result includes spoilt characters. Raises LinkError if the line is lost.
        """
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Detected:
    """The detected settings and protocols of a line.

    settings: with one stop bit, because two cannot be distinguished from one. protocols: names, the most frequent
    first. telegrams: number of sound ones that were heard. understood: fraction of the characters that belong to them.
    spoilt: fraction of the characters with a wrong parity or stop bit.
    """

    settings: LineSettings
    protocols: tuple[str, ...]
    telegrams: int
    understood: float
    spoilt: float


def detect(
    line: ListeningLine, protocols: Iterable[Protocol], baud_rates: Sequence[int] = USUAL_BAUD_RATES
) -> Detected | None:
    """Return the settings and protocols of a line; None if no telegram could be decoded with any settings."""
    known = list(protocols)
    for baudrate in baud_rates:
        if _is_right(line, known, baudrate):
            return _best(line, known, baudrate)
    return None


def _is_right(line: ListeningLine, protocols: Sequence[Protocol], baudrate: int) -> bool:
    ten_bits, eleven_bits = _settings(baudrate, _TEN_BITS), _settings(baudrate, _ELEVEN_BITS)
    heard = line.listen(ten_bits, _LOOK)
    if _judge(heard, protocols, ten_bits) or _judge(_seven_bits(heard), protocols, ten_bits):
        return True
    return _judge(line.listen(eleven_bits, _LOOK), protocols, eleven_bits) is not None


def _seven_bits(heard: LineSample) -> LineSample:
    """Return the same characters without the eighth bit, which may be their parity."""
    pieces = [replace(piece, data=bytes(byte & 0x7F for byte in piece.data)) for piece in heard.pieces]
    return replace(heard, pieces=pieces)


def _best(line: ListeningLine, protocols: Sequence[Protocol], baudrate: int) -> Detected | None:
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
    """Return the result with these settings; None if there are no sound telegrams or so few that they may be chance."""
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
    """Yield protocol and bytes of each sound telegram, also if its direction is open."""
    for item in items:
        if isinstance(item, HeardTelegram):
            yield item.protocol, item.data
        elif isinstance(item, AmbiguousTelegram) and len({name for name, _, _ in item.readings}) == 1:
            yield item.readings[0][0], item.data
