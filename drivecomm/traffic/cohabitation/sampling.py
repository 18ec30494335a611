"""Restrictions of a codec beyond the form of a telegram, found by decoding telegrams with arbitrary contents.

A codec selects among its forms, for example by a command, and a message may reject values that its leaves accept. So
only some contents make a telegram that decodes to its own form. These samples help to build telegrams. They exclude
none, because a character may be accepted only in combinations that were not sampled.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import log2
from random import Random
from typing import TYPE_CHECKING

from drivecomm.errors import DriveCommError, TelegramError
from drivecomm.traffic.cohabitation.outlines import TelegramCharacter

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from drivecomm.protocol import Codec
    from drivecomm.traffic.cohabitation.outlines import TelegramOutline

_TRIES, _MORE_TRIES = 40, 8_000
"""Number of sample telegrams per form, and the larger number for forms of which no sample was read.

Most forms show their direction with the first sample.
"""

_VARIED = 3
"""Number of telegrams whose characters are varied, one at a time."""

_ENOUGH = 10
"""Number of telegrams after which an unchanged character counts as constant.

A character with two equally likely values is mistaken for a constant once in five hundred times.
"""

_DIGITS = b"01"
"""Digits with which a readable telegram is filled: address 00 does not exist, and numbers have only a few decimals."""


def sampled_outline(outline: TelegramOutline, codec: Codec) -> TelegramOutline | None:
    """Return an outline limited to the contents that the codec was seen to read; None if no sample was read."""
    tried = list(_attempts(outline, _TRIES))
    return _narrowed(outline, codec, [each for each in tried if _is_read(each[0], outline, codec)], len(tried))


def sampled_more(outlines: Sequence[TelegramOutline], codec: Codec) -> list[TelegramOutline | None]:
    """Return the same as `sampled_outline`, with more samples, for a form that only a few contents satisfy.

    Samples of all directions are tried in turn. The first one that is read is enough: the list holds its outline only,
    or nothing.
    """
    for together in zip(*(_attempts(outline, _MORE_TRIES) for outline in outlines), strict=False):
        for outline, each in zip(outlines, together, strict=True):
            if _is_read(each[0], outline, codec):
                return [_narrowed(outline, codec, [each], _MORE_TRIES)]
    return []


_Attempt = tuple[bytes, "Sequence[TelegramCharacter]"]


def round_trip(data: bytes, outline: TelegramOutline, codec: Codec) -> bytes | None:
    """Return the telegram after one decode/encode round trip, or None if it does not decode to the same form."""
    try:
        message = codec.decode(data, outline.direction)
        return codec.encode(message) if type(message) is outline.form.message else None
    except DriveCommError:
        return None


def with_constants(outline: TelegramOutline, codec: Codec) -> TelegramOutline:
    """Return an outline whose usual contents are constant wherever the codec was seen to write a single character."""
    written: list[bytes] = []
    for data, spots in _attempts(outline, _TRIES):
        text = round_trip(data, outline, codec)
        if text is not None and len(text) == len(spots):
            written.append(text)
    places = list(outline.usual or outline.places)
    runs = [number for number, place in enumerate(places) if place.repeats]
    if len(written) < _ENOUGH:
        return outline
    for number, place in enumerate(places):
        if place.repeats or len(place.allowed) == 1:
            continue
        # Count places from the nearer end, because runs differ in length.
        behind = sum(number > run for run in runs)
        if behind < max(1, len(runs)) or not runs:
            codes = {text[number] for text in written} if not behind else place.allowed
        else:
            codes = {text[number - len(places)] for text in written}
        if len(codes) == 1:
            places[number] = replace(place, allowed=frozenset(codes))
    return replace(outline, usual=tuple(places))


def _attempts(outline: TelegramOutline, count: int) -> Iterator[_Attempt]:
    """Yield sample telegrams; one in twenty has digits wherever allowed. With a high count the runs are short."""
    chance = Random(outline.title)  # noqa: S311 - repeatable on purpose
    for number in range(count):
        if number % 20 == 0:
            sizes = any_sizes(outline, chance)
            if count > _TRIES or number == 0:
                sizes = {leaf: min(length.by_size, default=0) for leaf, length in outline.lengths.items()}
            spots = outline.spots(sizes, chance)
            if spots is None:
                continue
            drafts = Draft([_filled(spots, _DIGITS[number // 20 % 2])]), Draft([spots])
        if spots is not None:
            data = drafts[number % 20 > 0].written(chance)
            if data is not None:
                yield data, spots


def _filled(spots: Sequence[TelegramCharacter], code: int) -> list[TelegramCharacter]:
    return [
        TelegramCharacter(frozenset([code])) if spot.check is None and code in spot.allowed else spot for spot in spots
    ]


def _narrowed(outline: TelegramOutline, codec: Codec, read: Sequence[_Attempt], tried: int) -> TelegramOutline | None:
    if not read or len(read) == tried:
        return outline if read else None
    places = list(outline.places)
    counters = {length.counter for length in outline.lengths.values()}
    runs = [number for number, place in enumerate(places) if place.repeats]
    for number, place in enumerate(places):
        # The position of a place behind two or more runs is unknown.
        behind = sum(number > run for run in runs)
        if place.repeats or place.leaf in counters or len(place.allowed) == 1 or behind > 1:
            continue
        found: set[int] = set()
        for data, spots in {each[0]: each for each in (*read[: _VARIED - 1], read[-1])}.values():
            at = number + (len(spots) - len(places) if behind else 0)
            if spots[at].check is not None:
                found |= place.allowed
            else:
                found |= _read_at(outline, codec, (data, spots), at, place.allowed - found)
        places[number] = replace(place, allowed=frozenset(found))
    return replace(outline, usual=tuple(places))


def _read_at(outline: TelegramOutline, codec: Codec, attempt: _Attempt, at: int, others: frozenset[int]) -> set[int]:
    """Return the character at a place, and the others with which the telegram still decodes to its form."""
    chance = Random(0)  # noqa: S311 - repeatable on purpose
    data, spots = attempt
    kept = [
        spot if spot.check else TelegramCharacter(frozenset([code])) for spot, code in zip(spots, data, strict=True)
    ]
    found = {data[at]}
    for code in others:
        kept[at] = TelegramCharacter(frozenset([code]))
        changed = Draft([kept]).written(chance)
        if changed is not None and _is_read(changed, outline, codec):
            found.add(code)
    return found


def _is_read(data: bytes, outline: TelegramOutline, codec: Codec) -> bool:
    try:
        return type(codec.decode(data, outline.direction)) is outline.form.message
    except TelegramError:
        return False


_USUAL_RUN = 40
"""Longest usual run, in characters; longer ones are written only if no shorter one is possible."""


@dataclass(frozen=True, slots=True)
class TelegramWindow:
    """The part of the traffic in which another telegram would have to appear.

    start: position of its first character. spots: the characters of the telegram. hears: translation table from sent to
    heard characters.
    """

    start: int
    spots: Sequence[TelegramCharacter]
    hears: bytes


def any_sizes(outline: TelegramOutline, chance: Random) -> dict[int, int]:
    """Return random sizes for the leaves of variable size, short ones as a rule."""
    sizes = {}
    for leaf, length in outline.lengths.items():
        known = list(length.by_size)
        usual = [size for size in known if size <= _USUAL_RUN] or known[:1]
        sizes[leaf] = chance.choice(usual) if usual else 0
    return sizes


class Draft:
    """Consecutive telegrams whose characters are still to be chosen. telegrams: the spots of each."""

    def __init__(self, telegrams: Sequence[Sequence[TelegramCharacter]], window: TelegramWindow | None = None) -> None:
        self._starts: list[int] = []
        self._spots: list[TelegramCharacter] = []
        self._choices: list[tuple[int, ...]] = []
        self._window = window
        for spots in telegrams:
            self._starts.extend([len(self._spots)] * len(spots))
            self._spots.extend(spots)
        for at, spot in enumerate(self._spots):
            choices = spot.allowed
            if (looked_for := self._looked_for(at)) is not None and window is not None:
                choices = frozenset(code for code in choices if window.hears[code] in looked_for.allowed)
            self._choices.append(tuple(sorted(choices)))

    @property
    def possible(self) -> bool:
        """Whether at least one choice remains for each character."""
        return all(self._choices)

    @property
    def bits(self) -> int:
        """Number of bits that must be right by chance for the telegram in the window, check characters included."""
        odds = 0.0
        for at, spot in enumerate(self._spots):
            looked_for = self._looked_for(at)
            if looked_for is None:
                continue
            choices = len(self._choices[at])
            odds += log2(len(spot.allowed)) - (0 if looked_for.check else log2(choices))
        return round(odds)

    def written(self, chance: Random) -> bytes | None:
        """Return characters in which every check is right, or None if this attempt failed."""
        data = bytearray()
        heard = bytearray()
        window = self._window
        off = chance.random() < 0.5
        for at, spot in enumerate(self._spots):
            choices: Sequence[int] = self._choices[at]
            if spot.check is not None:
                check, number = spot.check
                said = (
                    check.off
                    if off and check.off is not None
                    else check.compute(bytes(data[self._starts[at] + check.start : at - number]))
                )
                choices = [said[number]] if said[number] in choices else []
            looked_for = self._looked_for(at)
            if window is not None and looked_for is not None and looked_for.check is not None:
                check, number = looked_for.check
                covered = bytes(heard[window.start + check.start : at - number])
                wanted = {check.compute(covered)[number]}
                if check.off is not None:
                    wanted.add(check.off[number])
                choices = [code for code in choices if window.hears[code] in wanted]
            if not choices:
                return None
            code = chance.choice(choices)
            data.append(code)
            heard.append(window.hears[code] if window is not None else code)
        return bytes(data)

    def _looked_for(self, at: int) -> TelegramCharacter | None:
        window = self._window
        if window is None or not window.start <= at < window.start + len(window.spots):
            return None
        return window.spots[at - window.start]


def any_telegram(outline: TelegramOutline, chance: Random) -> bytes | None:
    """Return a telegram of this form with arbitrary contents, or None if this attempt failed."""
    spots = outline.spots(any_sizes(outline, chance), chance)
    return None if spots is None else Draft([spots]).written(chance)
