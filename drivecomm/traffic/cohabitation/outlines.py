"""Outlines: the form of a telegram as a sequence of places, each with the characters that it may hold."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from drivecomm.protocol.schema import CheckCharacters, Leaf, Until
from drivecomm.traffic.cohabitation import alphabets

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from random import Random

    from drivecomm.protocol import Direction
    from drivecomm.protocol.schema import Form

_MEASURABLE = 2
"""Largest size, in characters, of an address or length field; all contents of such a field are enumerated."""


@dataclass(frozen=True, slots=True, eq=False)
class OutlinePlace:
    """One character of a telegram, or a run of any number of characters.

    leaf: number of the form's leaf to which the place belongs.
    """

    allowed: frozenset[int]
    leaf: int
    repeats: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class TelegramCharacter:
    """One character of a telegram of known length.

    check: for a check character, its leaf and its position in that leaf.
    """

    allowed: frozenset[int]
    check: tuple[CheckCharacters, int] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class TelegramOutline:
    """A form in one direction, with the address that it carries.

    places: its characters in order. lengths: for each leaf of variable size, by leaf number, the leaf that counts it
    and the contents of that counter for each size. usual: the same places, limited to contents that were actually read;
    an arbitrary telegram uses either. to_all: whether the telegram is for all drives.
    """

    title: str
    form: Form[Any]
    direction: Direction
    places: tuple[OutlinePlace, ...]
    lengths: Mapping[int, Length]
    usual: tuple[OutlinePlace, ...] = ()
    to_all: bool = False

    def following(self, place: int) -> Iterator[int]:
        """Yield the places that may come after a place. -1 is the beginning, len(places) is the end."""
        if place >= 0 and self.places[place].repeats:
            yield place
        place += 1
        while place < len(self.places) and self.places[place].repeats:
            yield place
            place += 1
        yield place

    def spots(self, sizes: Mapping[int, int], chance: Random) -> list[TelegramCharacter] | None:
        """Return the characters of a telegram with leaves of these sizes; None if a counter cannot express its size."""
        counted: dict[int, bytes] = {}
        for leaf, length in self.lengths.items():
            said = length.by_size.get(sizes.get(leaf, -1))
            if not said or length.counter in counted:
                return None
            counted[length.counter] = chance.choice(said)
        spots: list[TelegramCharacter] = []
        number: dict[int, int] = {}
        leaves = self.form.leaves
        for place in chance.choice((self.places, self.usual or self.places)):
            inner = leaves[place.leaf][1]
            if place.repeats:
                spots.extend([TelegramCharacter(place.allowed)] * sizes[place.leaf])
                continue
            at = number.get(place.leaf, 0)
            number[place.leaf] = at + 1
            allowed = frozenset([counted[place.leaf][at]]) if place.leaf in counted else place.allowed
            if not allowed <= place.allowed or not allowed:
                return None
            spots.append(TelegramCharacter(allowed, (inner, at) if isinstance(inner, CheckCharacters) else None))
        return spots


@dataclass(frozen=True, slots=True, eq=False)
class Length:
    """The length of a leaf of variable size.

    counter: number of the leaf that holds the length; -1 if none does. by_size: contents of that leaf for each size.
    """

    counter: int
    by_size: Mapping[int, tuple[bytes, ...]]


def with_addresses(
    plain: TelegramOutline, means: Callable[[Mapping[str, Any], bytes, Leaf], bool | None]
) -> Iterator[TelegramOutline]:
    """Yield an outline for each relevant address; addresses of one character are combined into one outline.

    means: returns False for an address of one drive, True for all drives, and None for an irrelevant address. Its
    arguments are the fields that the address sets, the characters and the leaf. A form without an address is yielded
    unchanged.
    """
    found = _address(plain.form)
    if found is None:
        yield plain
        return
    number, leaf = found
    kept: dict[bool, list[bytes]] = {False: [], True: []}
    for data, value in alphabets.words(leaf):
        try:
            to_all = means(_fields(plain.form, number, value), data, leaf)
        except ValueError:
            # The form cannot express this value, so it never occurs in a telegram.
            continue
        if to_all is not None:
            kept[to_all].append(data)
    for to_all, said in kept.items():
        # Addresses of one character fit into one place, so one outline covers them all.
        groups = [said] if said and leaf.size == 1 else [[each] for each in said]
        for group in groups:
            places, usual = _with(plain.places, number, group), _with(plain.usual, number, group)
            yield replace(plain, places=places, usual=usual, to_all=to_all)


def limited_to(outline: TelegramOutline, limits: TelegramOutline) -> TelegramOutline:
    """Return an outline whose usual contents are limited to those of another outline of the same form.

    A place for which nothing would remain keeps its own contents.
    """
    usual = tuple(
        replace(place, allowed=place.allowed & limit.allowed or place.allowed)
        for place, limit in zip(outline.places, limits.usual or limits.places, strict=True)
    )
    return replace(outline, usual=usual)


def as_usual(outline: TelegramOutline) -> TelegramOutline:
    """Return an outline that allows only its usual contents."""
    return replace(outline, places=outline.usual) if outline.usual else outline


def has_address(form: Form[Any]) -> bool:
    """Whether telegrams of this form name a drive."""
    return _address(form) is not None


def _with(places: tuple[OutlinePlace, ...], leaf: int, group: list[bytes]) -> tuple[OutlinePlace, ...]:
    narrowed, at = [], 0
    for place in places:
        if place.leaf == leaf:
            narrowed.append(replace(place, allowed=frozenset(word[at] for word in group)))
            at += 1
        else:
            narrowed.append(place)
    return tuple(narrowed)


def _address(form: Form[Any]) -> tuple[int, Leaf] | None:
    for number, (name, leaf) in enumerate(form.leaves):
        if name and _is_measurable(leaf):
            told = {each for names, (_, wanted) in form.reads.items() if wanted == (name,) for each in names}
            if "address" in told or (name == "address" and "address" in form.names):
                return number, leaf
    return None


def _fields(form: Form[Any], number: int, value: Any) -> dict[str, Any]:
    """Return the message fields that follow from this leaf alone."""
    name = form.leaves[number][0]
    fields = {name: value} if name in form.names else {}
    for names, (function, wanted) in form.reads.items():
        if wanted == (name,):
            told = function(value)
            fields.update({names[0]: told} if len(names) == 1 else dict(zip(names, told, strict=True)))
    return fields


def outline_of(
    title: str, form: Form[Any], direction: Direction, characters: Callable[[Leaf], tuple[frozenset[int], ...]]
) -> TelegramOutline:
    """Return the outline of a form with any address.

    characters: returns the characters with which a fixed-size leaf may be read, or written.
    """
    places: list[OutlinePlace] = []
    lengths: dict[int, Length] = {}
    leaves = form.leaves
    for number, (_, leaf) in enumerate(leaves):
        if isinstance(leaf.size, int):
            places.extend(OutlinePlace(allowed, number) for allowed in characters(leaf))
        else:
            length, allowed = _variable(leaf, leaves[:number])
            places.append(OutlinePlace(allowed, number, repeats=True))
            lengths[number] = length
    return TelegramOutline(title, form, direction, tuple(places), lengths)


def _variable(leaf: Leaf, before: Sequence[tuple[str, Leaf]]) -> tuple[Length, frozenset[int]]:
    """Return the length of a leaf of variable size, and the characters that it accepts."""
    if isinstance(leaf.size, Until):
        # No other leaf states the size of this leaf; it ends at a terminator.
        return Length(-1, dict.fromkeys(range(leaf.size.least, leaf.size.most + 1), (b"",))), frozenset(leaf.alphabet)
    for number, (name, counter) in enumerate(before):
        if not name or not _is_measurable(counter):
            continue
        by_size: dict[int, list[bytes]] = {}
        sample: dict[str, Any] = {}
        for data, value in alphabets.words(counter):
            try:
                size = int(leaf.size({name: value}))
            except (KeyError, TypeError, AttributeError):
                break
            by_size.setdefault(size, []).append(data)
            if size and (not sample or size < leaf.size(sample)):
                sample = {name: value}
        if sample:
            length = Length(number, {size: tuple(said) for size, said in sorted(by_size.items())})
            repeated = leaf.size(sample)
            return length, frozenset(code for code in range(256) if alphabets.accepts(leaf, bytes([code]) * repeated))
    return Length(-1, {}), alphabets.ALL


def _is_measurable(leaf: Leaf) -> bool:
    return isinstance(leaf.size, int) and 1 <= leaf.size <= _MEASURABLE
