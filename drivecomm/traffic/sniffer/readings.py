"""Readings of the undecided bytes at one position, made with the codecs of the protocols."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

from drivecomm.errors import TelegramError

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from drivecomm.protocol import Codec, Direction, Message, Parity, Protocol


# Longer than any telegram, see drivecomm.protocol.framing.
_HEAD = 512
# The same bytes are decoded repeatedly: when a master polls, and in a flood.
_REMEMBERED = 256
# Fewer bytes say so little that they count as a telegram only if one is due.
SHORTEST_LONG = 4


class TelegramReading(NamedTuple):
    """A sound telegram from `start` up to `end`.

    data: without parity bits, if the line has seven data bits. parity: the parity that the eighth bits had, "N" for
    eight data bits.
    """

    start: int
    end: int
    protocol: Protocol
    direction: Direction
    data: bytes
    message: Message
    parity: Parity = "N"

    @property
    def short(self) -> bool:
        """Whether the telegram is so short that it may be chance."""
        return self.end - self.start < SHORTEST_LONG


@dataclass(frozen=True, slots=True)
class BrokenTelegram:
    """Bytes with the shape of a telegram that do not decode."""

    start: int
    end: int
    protocol: Protocol
    direction: Direction
    error: TelegramError


class UnfinishedTelegram:
    """The beginning of a telegram that may be completed by more bytes."""


Look: TypeAlias = TelegramReading | BrokenTelegram | UnfinishedTelegram | None
_UNFINISHED = UnfinishedTelegram()
_made = tuple.__new__


class TelegramReader:
    """Reader of telegrams of one protocol in one direction."""

    def __init__(self, protocol: Protocol, codec: Codec, direction: Direction) -> None:
        self.protocol = protocol
        self.direction: Direction = direction
        self.parity: Parity = "N"
        self.gap_s = protocol.facts.gap_s
        self._codec = codec
        self._decoded = lru_cache(maxsize=_REMEMBERED)(self._decode)

    def begins_with(self, byte: int) -> bool:
        """Whether a telegram can begin with this byte."""
        return self._codec.measure(bytes([byte]), self.direction) != 0

    def goes_beyond(self, pair: bytes) -> bool:
        """Whether a longer telegram can begin with these one or two characters."""
        text = self._text(pair, 0, 2)
        return len(text) == len(pair) and self._codec.measure(text, self.direction) > len(pair)

    def ends_with_first(self, byte: int) -> bool:
        """Whether no telegram of two or more characters can begin with this byte twice."""
        return self._codec.measure(self._text(bytes([byte, byte]), 0, 2), self.direction) <= 1

    def fits(self, data: bytes) -> bool:
        """Whether these bytes have the length of a telegram that begins with them, or cannot begin a telegram."""
        text = self._text(data, 0, len(data))
        needed = self._codec.measure(text, self.direction)
        return not needed or needed == len(text) == len(data)

    def look(self, data: bytes, start: int, limit: int) -> Look:
        """Return the telegram that begins at `start`, where bytes up to `limit` belong to it and more may follow.

        Return None if no telegram begins there.
        """
        end = min(limit, start + _HEAD)
        head = self._text(data, start, end)
        over = start + len(head) < end
        needed = self._codec.measure(head, self.direction)
        if not needed:
            return None
        if needed <= len(head) or over:
            return self._read(head if needed == len(head) else head[:needed], start)
        if needed <= limit - start:
            return self._read(self._text(data, start, start + needed), start)
        return _UNFINISHED

    def look_at_rest(self, data: bytes, start: int, limit: int) -> Look:
        """Return the whole or broken telegram that begins at `start`; no bytes follow after `limit`.

        Return None if no telegram begins there.
        """
        found = self.look(data, start, limit)
        return self._read(self._text(data, start, limit), start) if isinstance(found, UnfinishedTelegram) else found

    def _text(self, data: bytes, start: int, end: int) -> bytes:
        """Return the characters from `start` on, up to the first that does not have this reader's format."""
        return data[start:end]

    def _read(self, taken: bytes, start: int) -> TelegramReading | BrokenTelegram:
        message = self._decoded(taken)
        end = start + len(taken)
        if isinstance(message, TelegramError):
            return BrokenTelegram(start, end, self.protocol, self.direction, message)
        return _made(TelegramReading, (start, end, self.protocol, self.direction, taken, message, self.parity))

    def _decode(self, data: bytes) -> Message | TelegramError:
        try:
            return self._codec.decode(data, self.direction)
        except TelegramError as error:
            return error.with_traceback(None)


class SevenBitReader(TelegramReader):
    """Reader of seven-bit telegrams from a listener set to 8N1, which receives the parity as the eighth bit."""

    def __init__(self, protocol: Protocol, codec: Codec, direction: Direction, parity: Parity) -> None:
        super().__init__(protocol, codec, direction)
        self.parity = parity
        self._plain = bytes(byte & 0x7F for byte in range(256))
        self._wrong = bytes(byte != byte & 0x7F | _parity_bit(byte & 0x7F, parity) for byte in range(256))

    def begins_with(self, byte: int) -> bool:
        """Whether a telegram can begin with this byte."""
        return not self._wrong[byte] and super().begins_with(byte & 0x7F)

    def _text(self, data: bytes, start: int, end: int) -> bytes:
        """Return the characters without their parity bits, up to the first with a wrong parity."""
        heard = data[start:end]
        wrong = heard.translate(self._wrong).find(1)
        return (heard if wrong < 0 else heard[:wrong]).translate(self._plain)


def without_ambiguous(protocols: Iterable[Protocol]) -> list[Protocol]:
    """Return the protocols without each one that is ambiguous with an earlier one, as both must declare."""
    known: list[Protocol] = []
    for each in protocols:
        if not any(each.name in other.ambiguous_with and other.name in each.ambiguous_with for other in known):
            known.append(each)
    return known


def readers_of(protocol: Protocol, options: Any) -> list[TelegramReader]:
    """Return the readers of a protocol for both directions, also for seven data bits that are received as eight."""
    directions: tuple[Direction, Direction] = ("request", "reply")
    chosen = protocol.options() if options is None else options
    # A codec may store its last measurement, so each reader has its own codec.
    readers = [TelegramReader(protocol, protocol.codec(chosen), direction) for direction in directions]
    settings = protocol.facts.settings
    if settings.bytesize == 7 and settings.parity != "N":
        readers += [
            SevenBitReader(protocol, protocol.codec(chosen), direction, settings.parity) for direction in directions
        ]
    return readers


def _parity_bit(byte: int, parity: Parity) -> int:
    odd = byte.bit_count() % 2
    return 0x80 * {"E": odd, "O": 1 - odd, "M": 1, "S": 0, "N": 0}[parity]


# A sound reading of random bytes is rare and two are much rarer, so the number of readings counts most.
_EACH = 8
# A VABus select contains the reply with the same value; the reading that accounts for all bytes wins.
_LEFT_OVER, _MANY = 3, 2
_CLEARLY_BETTER = 2


@dataclass(frozen=True, slots=True)
class Candidate:
    """One telegram that may have been sent, in either direction.

    merit: points for and against it besides its bytes.
    """

    readings: tuple[TelegramReading, ...]
    merit: int

    @property
    def start(self) -> int:
        """Position of its first byte."""
        return self.readings[0].start

    @property
    def end(self) -> int:
        """Position behind its last byte."""
        return self.readings[0].end


@dataclass(frozen=True, slots=True)
class _Choice:
    """Consecutive candidates. end: position behind the last. left_over: unexplained characters before that position."""

    weight: int
    end: int
    left_over: int
    chosen: tuple[Candidate, ...] = ()

    def behind(self, next_one: Candidate) -> _Choice:
        left_over = min(_MANY, self.left_over + next_one.start - self.end)
        return _Choice(self.weight + _EACH + next_one.merit, next_one.end, left_over, (*self.chosen, next_one))

    def complete(self, end: int) -> int:
        """Return the weight of this choice if no candidate follows."""
        return self.weight - _LEFT_OVER * min(_MANY, self.left_over + end - self.end)


def choose(candidates: Sequence[Candidate]) -> list[Candidate] | None:
    """Return candidates without common bytes that explain the bytes best, in order; None if two choices are as good."""
    begin, end = min(each.start for each in candidates), max(each.end for each in candidates)
    choices = [_Choice(weight=0, end=begin, left_over=0)]
    for each in sorted(candidates, key=lambda each: each.end):
        longer = [choice.behind(each) for choice in choices if choice.end <= each.start]
        # A choice that is not among the two best for its left_over cannot become one of the two best overall.
        for left_over in range(_MANY + 1):
            choices += _best(choice for choice in longer if choice.left_over == left_over)
    ranked = sorted(choices, key=lambda choice: choice.complete(end), reverse=True)[:2]
    best, second = ranked
    return None if best.complete(end) - second.complete(end) < _CLEARLY_BETTER else list(best.chosen)


def _best(choices: Iterable[_Choice]) -> list[_Choice]:
    return sorted(choices, key=lambda choice: choice.weight, reverse=True)[:2]
