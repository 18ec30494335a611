"""A form as the places of its telegram, each with the characters that may stand there."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from drivecomm.protocol.schema import Check, Leaf, Until
from drivecomm.traffic.cohabitation import alphabets

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from random import Random

    from drivecomm.protocol import Direction
    from drivecomm.protocol.schema import Form

_MEASURABLE = 2
"""Fields that say an address or a length have one or two characters; their contents are gone through."""


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """A character of a telegram, or a run of any number of them. leaf: which leaf of the form it belongs to."""

    allowed: frozenset[int]
    leaf: int
    repeats: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Spot:
    """A character of a telegram of known length. check: the leaf that it is a check character of, and which of them."""

    allowed: frozenset[int]
    check: tuple[Check, int] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """A form of one direction, with the address that it carries.

    places: its characters in order. lengths: for a leaf of variable size, by its number: which leaf counts it, and what
    that holds for each size. usual: the places again, with what telegrams that were read had there; arbitrary telegrams
    are made of either. to_all: whether it is for all drives.
    """

    title: str
    form: Form[Any]
    direction: Direction
    places: tuple[Place, ...]
    lengths: Mapping[int, Length]
    usual: tuple[Place, ...] = ()
    to_all: bool = False

    def following(self, place: int) -> Iterator[int]:
        """Yield the places that may come after a place; -1 stands for the beginning, len(places) for the end."""
        if place >= 0 and self.places[place].repeats:
            yield place
        place += 1
        while place < len(self.places) and self.places[place].repeats:
            yield place
            place += 1
        yield place

    def spots(self, sizes: Mapping[int, int], chance: Random) -> list[Spot] | None:
        """Return the characters of a telegram with leaves of these sizes; None where no such telegram can be said."""
        counted: dict[int, bytes] = {}
        for leaf, length in self.lengths.items():
            said = length.by_size.get(sizes.get(leaf, -1))
            if not said or length.counter in counted:
                return None
            counted[length.counter] = chance.choice(said)
        spots: list[Spot] = []
        number: dict[int, int] = {}
        leaves = self.form.leaves
        for place in chance.choice((self.places, self.usual or self.places)):
            inner = leaves[place.leaf][1]
            if place.repeats:
                spots.extend([Spot(place.allowed)] * sizes[place.leaf])
                continue
            at = number.get(place.leaf, 0)
            number[place.leaf] = at + 1
            allowed = frozenset([counted[place.leaf][at]]) if place.leaf in counted else place.allowed
            if not allowed <= place.allowed or not allowed:
                return None
            spots.append(Spot(allowed, (inner, at) if isinstance(inner, Check) else None))
        return spots


@dataclass(frozen=True, slots=True, eq=False)
class Length:
    """counter: the leaf that says how long another one is. by_size: what it may hold, by the size that it says."""

    counter: int
    by_size: Mapping[int, tuple[bytes, ...]]


def addressed(plain: Outline, means: Callable[[Mapping[str, Any], bytes, Leaf], bool | None]) -> Iterator[Outline]:
    """Yield an outline with the addresses that matter, one for each way to say them where that has several characters.

    means: given the fields that the address says, its characters and its leaf: False for one drive, True for all, None
    for an address that does not matter. A form without an address is yielded as it is.
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
            # No telegram says so.
            continue
        if to_all is not None:
            kept[to_all].append(data)
    for to_all, said in kept.items():
        # What is said in one character can be said at once.
        groups = [said] if said and leaf.size == 1 else [[each] for each in said]
        for group in groups:
            places, usual = _with(plain.places, number, group), _with(plain.usual, number, group)
            yield replace(plain, places=places, usual=usual, to_all=to_all)


def within(outline: Outline, limits: Outline) -> Outline:
    """Return an outline whose usual contents are those of another one of the same form, where it allows them."""
    usual = tuple(
        replace(place, allowed=place.allowed & limit.allowed or place.allowed)
        for place, limit in zip(outline.places, limits.usual or limits.places, strict=True)
    )
    return replace(outline, usual=usual)


def as_usual(outline: Outline) -> Outline:
    """Return an outline that allows its usual contents only."""
    return replace(outline, places=outline.usual) if outline.usual else outline


def has_address(form: Form[Any]) -> bool:
    """Whether telegrams of this form name a drive."""
    return _address(form) is not None


def _with(places: tuple[Place, ...], leaf: int, group: list[bytes]) -> tuple[Place, ...]:
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
    """Return the fields of the message that follow from this leaf alone."""
    name = form.leaves[number][0]
    fields = {name: value} if name in form.names else {}
    for names, (function, wanted) in form.reads.items():
        if wanted == (name,):
            told = function(value)
            fields.update({names[0]: told} if len(names) == 1 else dict(zip(names, told, strict=True)))
    return fields


def outline_of(
    title: str, form: Form[Any], direction: Direction, characters: Callable[[Leaf], tuple[frozenset[int], ...]]
) -> Outline:
    """Return a form's outline with any address. characters: what a leaf of fixed size may be read or written with."""
    places: list[Place] = []
    lengths: dict[int, Length] = {}
    leaves = form.leaves
    for number, (_, leaf) in enumerate(leaves):
        if isinstance(leaf.size, int):
            places.extend(Place(allowed, number) for allowed in characters(leaf))
        else:
            length, allowed = _variable(leaf, leaves[:number])
            places.append(Place(allowed, number, repeats=True))
            lengths[number] = length
    return Outline(title, form, direction, tuple(places), lengths)


def _variable(leaf: Leaf, before: Sequence[tuple[str, Leaf]]) -> tuple[Length, frozenset[int]]:
    """Return how a leaf of variable size is counted, and the characters that it may hold at each place."""
    if isinstance(leaf.size, Until):
        # Nothing counts it.
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
