"""Leaves: characters of a telegram that mean one value. The kinds of leaves are in `leaves`."""

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
"""Categories of faults in a telegram, the gravest first, so that noise is never reported as a wrong value."""


class LeafFault(Exception):  # noqa: N818 - internal, the form turns it into a TelegramError
    """Failure to read or write one leaf.

    field: the name of the leaf, empty if it has none.
    """

    def __init__(self, category: Category, message: str, field: str = "") -> None:
        self.category: Category = category
        self.field = field
        super().__init__(message)


def cut_off(size: int, found: bytes) -> LeafFault:
    """Return the fault of a leaf in which the telegram ends."""
    return LeafFault("length", f"{size} characters expected, {len(found)} left")


ANY = bytes(range(256))
"""All characters, in one byte string."""
ONE_CHARACTER = tuple(bytes([value]) for value in ANY)
"""All byte strings of one character."""


@dataclass(frozen=True, slots=True)
class Until:
    """Size of a leaf that ends where a constant after it first occurs, see `until`."""

    end: bytes
    least: int
    most: int


def until(end: bytes, *, most: int, least: int = 0) -> Until:
    """Return the size of a leaf that reaches up to a constant after it, such as ETX.

    Leaves of fixed size may follow it before the constant. end: the constant's bytes, none of which the leaf may hold.
    least, most: the number of characters that the leaf can have; a receiver waits for no more. All leaves after it have
    a fixed size, so that a check character after the constant, or a telegram that is already cut out, may hold the
    constant's byte.
    """
    return Until(end, least, most)


if TYPE_CHECKING:
    _Construct = Construct[Any, Any]
else:
    _Construct = Construct


class Leaf(_Construct):
    """A known number of characters that mean one value.

    size: number of bytes, a construct expression over fields read before (`this.length - 1`), or `until` a constant.
    parse: converts bytes to a value. write: converts a value to bytes. Both raise ValueError for invalid input, and
    depend on nothing but their argument. category: the fault for invalid content. meaning: for the documentation.
    values: all possible values, whole numbers or texts, if they are few enough to be looked up and each is written in
    one way only. alphabet: the characters that the leaf may hold, at any place. emission: the code of the leaf; derived
    from the other arguments unless given.
    """

    decides = False
    """Whether a telegram with invalid content here is not of this leaf's form, see `deciding`."""
    implied = False
    """Whether the leaf can be written without a value."""

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
        """Return the value of this leaf, with this size, at a place of a telegram. Raises LeafFault."""
        found = data[place : place + size]
        if len(found) < size:
            raise cut_off(size, found)
        try:
            return self._parse_found(found)
        except Exception as error:  # noqa: BLE001 - any error of a leaf means an invalid value
            raise LeafFault(self.category, str(error)) from None

    def fault_at(self, place: int, size: int, data: bytes) -> LeafFault | None:
        """Return the fault of this leaf, with this size, at a place of a telegram; None if it is valid."""
        try:
            self.take_at(place, size, data)
        except LeafFault as fault:
            return fault
        return None

    def write_behind(self, before: bytes, value: Any, context: Any = None) -> bytes:  # noqa: ARG002 - check leaves use it
        """Return the characters for a value. Raises LeafFault.

        before: the characters of the leaves before this one. context: the values of all leaves.
        """
        try:
            written = self._write(value)
        except Exception as error:  # noqa: BLE001 - for example a text in place of a number
            raise LeafFault("field", "it is missing" if value is None else str(error)) from None
        if self.values is not None and self.words is not None:
            meant = self.words.get(written)
            if type(meant) is not type(value) or meant != value:
                raise LeafFault("field", f"{value!r} is not allowed here")
        size = self.size_in(context, len(written))
        if len(written) != size:
            raise LeafFault("field", f"{len(written)} characters where {size} belong")
        return written

    def size_in(self, context: Any, left: int) -> int:
        """Return the number of characters in this leaf. Raises LeafFault.

        context: the values of the fields before it. left: the number of characters that are left for it.
        """
        if isinstance(self.size, Until):
            if not self.size.least <= left <= self.size.most:
                raise LeafFault("length", f"{left} characters where {self.size.least} to {self.size.most} belong")
            return left
        if not callable(self.size):
            return int(self.size)
        try:
            size = int(self.size(context))
        except TypeError:
            # A field that could not be read is None while faults are collected.
            raise LeafFault("length", "the length field before it is wrong") from None
        if size < 0:
            raise LeafFault("length", f"the length field before it leaves {size} characters")
        return size

    @cached_property
    def words(self) -> Mapping[bytes, Any] | None:
        """All contents of a leaf of fixed size, with their meanings; None if they are too many to list."""
        if self.values is not None:
            return {self._write(value): value for value in self.values}
        return (
            None
            if self.size != 1
            else {data: self._parse_found(data) for data in ONE_CHARACTER if not self.fault_at(0, 1, data)}
        )

    @cached_property
    def alphabets(self) -> Sequence[Collection[int]]:
        """Characters that may occur at each of its places; a single entry for all if the size is not fixed."""
        if not isinstance(self.size, int):
            return [self.alphabet]
        words = self.words
        return [self.alphabet if words is None else {word[place] for word in words} for place in range(self.size)]


def deciding(leaf: Leaf) -> Leaf:
    """Return a leaf whose content distinguishes its form from others, as a constant does: a command code or an address.

    The leaf must have a fixed size and contents that can be listed: a number with `allowed`, a `choice`, or a single
    character. Raises UsageError otherwise.
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
