"""A leaf: characters of a telegram that mean one value. What kinds of leaves there are stands in `leaves`."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from construct import Construct

from drivecomm.errors import UsageError
from drivecomm.protocol.schema import emission

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Mapping, Sequence

    from drivecomm.errors import Category
    from drivecomm.protocol.schema.emission import Emission

GRAVITY: tuple[Category, ...] = ("length", "framing", "checksum", "field")
"""What can be wrong with a telegram, the gravest first: noise is never called a wrong value."""


class Fault(Exception):  # noqa: N818 - never leaves this package, the form turns it into a TelegramError
    """One leaf could not be read or written; field is its name, empty where nobody named it."""

    def __init__(self, category: Category, message: str, field: str = "") -> None:
        self.category: Category = category
        self.field = field
        super().__init__(message)


def cut_off(size: int, found: bytes) -> Fault:
    """Return what is wrong with a leaf that the telegram ends in."""
    return Fault("length", f"{size} characters expected, {len(found)} left")


ANY = bytes(range(256))
"""All characters."""
ONE_CHARACTER = tuple(bytes([value]) for value in ANY)
"""All texts of one character."""


@dataclass(frozen=True, slots=True)
class Until:
    """The size of what ends where a constant behind it begins for the first time, see `until`."""

    end: bytes
    least: int
    most: int


def until(end: bytes, *, most: int, least: int = 0) -> Until:
    """Return the size of a leaf that reaches up to a constant behind it, such as ETX, or to what stands before that.

    end: the constant's bytes, none of which the leaf may hold. least, most: how many characters it can have; a receiver
    waits for no more. Everything behind the leaf has a fixed size, so that a check character behind the constant, or a
    telegram that is already cut out, may hold the constant's byte.
    """
    return Until(end, least, most)


if TYPE_CHECKING:
    _Construct = Construct[Any, Any]
else:
    _Construct = Construct


class Leaf(_Construct):
    """Characters of a known number that mean one value.

    size: number of bytes, a construct expression over fields read before (`this.length - 1`), or `until` a constant.
    parse: bytes to value. write: value to bytes. Both raise ValueError for what may not be, and depend on nothing but
    what they are given. category: what a wrong content is called. meaning: for the docs. values: all values that there
    are, whole numbers or texts, where they are few enough to be looked up instead, and each is written in one way only.
    alphabet: the characters that it may hold, at whatever place. emission: how the leaf is said in code; found from the
    rest unless given.
    """

    decides = False
    """Whether a telegram without a right content here is none of its form, see `deciding`."""
    implied = False
    """Whether it needs no value to be written."""

    def __init__(
        self,
        size: Any,
        parse: Callable[[bytes], Any],
        write: Callable[[Any], bytes],
        *,
        category: Category = "field",
        meaning: str = "",
        values: Iterable[Any] | None = None,
        alphabet: bytes = ANY,
        emission: Emission | None = None,
    ) -> None:
        super().__init__()
        if isinstance(size, Until) and set(size.end) & set(alphabet):
            raise UsageError(f"a leaf up to {size.end.hex(' ').upper()} says by `alphabet` that it never holds that")
        self.size = size
        self.category: Category = category
        self.meaning = meaning
        self.values = values
        self.alphabet = alphabet
        self.emission = emission or _emission(size, parse, write, values)
        self._parse_found = parse
        self._write = write

    def take_at(self, place: int, size: int, data: bytes) -> Any:
        """Read this leaf, of this size, at a place of a telegram. Raises Fault."""
        found = data[place : place + size]
        if len(found) < size:
            raise cut_off(size, found)
        try:
            return self._parse_found(found)
        except Exception as error:  # noqa: BLE001 - whatever a leaf of a package stumbles over is no value of it
            raise Fault(self.category, str(error)) from None

    def fault_at(self, place: int, size: int, data: bytes) -> Fault | None:
        """Return what is wrong with this leaf, of this size, at a place of a telegram."""
        try:
            self.take_at(place, size, data)
        except Fault as fault:
            return fault
        return None

    def write_behind(self, before: bytes, value: Any, context: Any = None) -> bytes:  # noqa: ARG002 - checks need it
        """Return the characters for a value, behind those of other leaves and their values. Raises Fault."""
        try:
            written = self._write(value)
        except Exception as error:  # noqa: BLE001 - a text where a number belongs, say
            raise Fault("field", "it is missing" if value is None else str(error)) from None
        if self.values is not None and self.words is not None:
            meant = self.words.get(written)
            if type(meant) is not type(value) or meant != value:
                raise Fault("field", f"{value!r} is not allowed here")
        size = self.size_in(context, len(written))
        if len(written) != size:
            raise Fault("field", f"{len(written)} characters where {size} belong")
        return written

    def size_in(self, context: Any, left: int) -> int:
        """Return how many characters it has, given the fields before it, and how many are left for it. Raises Fault."""
        if isinstance(self.size, Until):
            if not self.size.least <= left <= self.size.most:
                raise Fault("length", f"{left} characters where {self.size.least} to {self.size.most} belong")
            return left
        if not callable(self.size):
            return int(self.size)
        try:
            size = int(self.size(context))
        except TypeError:
            # While faults are collected, a field that could not be read is None.
            raise Fault("length", "the length field before it is wrong") from None
        if size < 0:
            raise Fault("length", f"the length field before it leaves {size} characters")
        return size

    @cached_property
    def words(self) -> Mapping[bytes, Any] | None:
        """All contents of a leaf of fixed size with what they mean; None where they are too many to be listed."""
        if self.values is not None:
            return {self._write(value): value for value in self.values}
        return (
            None
            if self.size != 1
            else {data: self._parse_found(data) for data in ONE_CHARACTER if not self.fault_at(0, 1, data)}
        )

    @cached_property
    def alphabets(self) -> Sequence[Collection[int]]:
        """The characters that may stand at each of its places; at all of them, where their number is not fixed."""
        if not isinstance(self.size, int):
            return [self.alphabet]
        words = self.words
        return [self.alphabet if words is None else {word[place] for word in words} for place in range(self.size)]


def deciding(leaf: Leaf) -> Leaf:
    """Return a leaf by whose content a telegram is told from others, as by a constant: a command code, an address.

    It has a fixed size and contents that can be listed: a number with `allowed`, a `choice`, or a single character.
    """
    if not isinstance(leaf.size, int) or leaf.words is None:
        raise UsageError(f"the leaf {leaf.meaning!r} cannot decide: what it may hold is not listed")
    decisive = copy(leaf)
    decisive.decides = True
    return decisive


def _emission(
    size: Any, parse: Callable[[bytes], Any], write: Callable[[Any], bytes], values: Iterable[Any] | None
) -> Emission | None:
    if values is None or not isinstance(size, int):
        return emission.called(size, parse, write)
    return emission.enumerated(size, values, type(next(iter(values), 0)), write)
