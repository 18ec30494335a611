"""The vocabulary of telegram schemas: leaves for what drive telegrams are made of.

A telegram is a flat row of these leaves, named as construct names parts (`"address" / unsigned(1)`). Each leaf reads
and writes a number of characters and refuses what it may not hold, and can say so in Python, for the form to make one
function of them (see `compiled`): construct is the way to declare, and reads and writes nothing itself.
Leaves with a name become fields of the message; nameless ones (constants, lengths, check characters) are filled in
when a telegram is built.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property, reduce
from operator import xor
from typing import TYPE_CHECKING, Any

from drivecomm.protocol.schema import emission
from drivecomm.protocol.schema.leaf import ONE_CHARACTER, Fault, Leaf, Until, cut_off

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Container, Mapping, Sequence


_DECIMAL, _HEX = b"0123456789", b"0123456789ABCDEF"

# Digits of a number that is looked up; the tables of longer ones would take more memory than they save time.
_LOOKED_UP = 2

# So many values are not listed in an error.
_MANY = 12


class _Constant(Leaf):
    """Exactly these bytes."""

    decides = implied = True

    def __init__(self, data: bytes, meaning: str) -> None:
        shown = data.hex(" ").upper()
        said = emission.fixed(data, must_be=True)
        super().__init__(
            len(data), lambda _: None, lambda _: data, category="framing", meaning=meaning or shown, emission=said
        )
        self._data, self._shown = data, f"{shown} {meaning}"
        self.words = {data: None}

    def take_at(self, place: int, size: int, data: bytes) -> None:
        """Look whether they are there."""
        if fault := self.fault_at(place, size, data):
            raise fault

    def fault_at(self, place: int, size: int, data: bytes) -> Fault | None:
        """Return what is wrong; most damage is found here and in checks, which raise nothing for it."""
        found = data[place : place + size]
        if found == self._data:
            return None
        if len(found) < size:
            return cut_off(size, found)
        return Fault("framing", f"{self._shown} expected, {found.hex(' ').upper()} found")


def constant(data: bytes, meaning: str = "") -> Leaf:
    """Exactly these bytes; anything else is a framing error."""
    return _Constant(data, meaning)


def choice(values: Mapping[bytes, Any], meaning: str = "") -> Leaf:
    """One of these byte strings of equal length, each standing for a value."""
    written = {value: data for data, value in values.items()}
    size, known = len(next(iter(values))), _listed(written)

    def parse(found: bytes) -> Any:
        if found not in values:
            raise ValueError(f"{found.hex(' ').upper()} is none of {known}")
        return values[found]

    def write(value: Any) -> bytes:
        if value not in written:
            raise ValueError(f"{value!r} is none of {known}")
        return written[value]

    chosen = Leaf(size, parse, write, meaning=meaning, emission=emission.looked_up(values))
    chosen.words = values
    return chosen


def one_of(values: Iterable[Any], write: Callable[[Any], bytes], meaning: str = "") -> Leaf:
    """One of these whole numbers or texts, each written in a way of its own, all in equally many characters."""
    known = [*values]

    def parse(found: bytes) -> Any:
        if found not in (leaf.words or ()):
            raise ValueError(f"{found!r} is none of {_listed(known)}")
        return (leaf.words or {})[found]

    leaf = Leaf(len(write(known[0])), parse, write, meaning=meaning, values=known)
    return leaf


def _listed(values: Iterable[Any]) -> str:
    shown = [*values]
    return ", ".join(map(repr, shown) if len(shown) < _MANY else [repr(shown[0]), "...", repr(shown[-1])])


def _within(value: Any, allowed: Container[int]) -> int:
    if type(value) is not int or value not in allowed:
        raise ValueError(f"{value!r} is not allowed here")
    return value


def decimal_number(digits: int, allowed: Container[int] | None = None, meaning: str = "") -> Leaf:
    """An unsigned number in this many ASCII decimal digits, most significant first, of those that are allowed."""

    def parse(found: bytes) -> int:
        if not found.isdigit():
            raise ValueError(f"{found!r} are not {digits} decimal digits")
        return int(found)

    said = "not {0}.isdigit()", "int({0})", b"%%0%dd" % digits
    return _number_in_digits(_DECIMAL, digits, parse, said, allowed=allowed, meaning=meaning)


def hex_number(digits: int, meaning: str = "", *, allowed: Container[int] | None = None) -> Leaf:
    """An unsigned number in this many upper-case hexadecimal ASCII digits, most significant first, of those allowed."""
    said = f"{{0}}.translate(None, {_HEX!r})", "int({0}, 16)", b"%%0%dX" % digits
    return _number_in_digits(_HEX, digits, hex_value, said, allowed=allowed, meaning=meaning)


def _number_in_digits(
    alphabet: bytes,
    digits: int,
    read: Callable[[bytes], int],
    said: tuple[str, str, bytes],
    *,
    allowed: Container[int] | None,
    meaning: str,
) -> Leaf:
    """Return a leaf of a number. said: how digits are found wrong, read and written, for `emission.digits`."""
    numbers = range(len(alphabet) ** digits)
    permitted = numbers if allowed is None else allowed
    return Leaf(
        digits,
        lambda found: _within(read(found), permitted),
        lambda value: said[2] % _within(value, permitted),
        meaning=meaning,
        values=_listed_numbers(numbers, allowed, few=digits <= _LOOKED_UP),
        alphabet=alphabet,
        emission=None if digits <= _LOOKED_UP else emission.digits(digits, *said, permitted),
    )


def hex_text(digits: int, meaning: str = "") -> Leaf:
    """This many upper-case hexadecimal digits as they stand, where their number says what they are."""

    def same(text: str) -> str:
        hex_value(text.encode("latin-1"))
        return text

    return Leaf(
        digits,
        lambda found: same(found.decode("latin-1")),
        lambda text: same(text).encode(),
        meaning=meaning,
        alphabet=_HEX,
    )


def hex_value(digits: bytes) -> int:
    """Return the number that upper-case hexadecimal digits stand for; ValueError for any other character."""
    if digits.translate(None, _HEX):
        raise ValueError(f"{digits.decode('latin-1')!r} is not made of the digits 0-9 and A-F")
    return int(digits, 16)


def shifted_character(base: int, allowed: Container[int], meaning: str = "") -> Leaf:
    """A number in one character: `base` plus the number."""

    def parse(found: bytes) -> int:
        return _within(found[0] - base, allowed)

    values = [number for number in range(-base, 256 - base) if number in allowed]
    return Leaf(1, parse, lambda value: bytes([base + _within(value, allowed)]), meaning=meaning, values=values)


def characters(size: Any, *, lowest: int = 0x20, highest: int = 0x7E, meaning: str = "") -> Leaf:
    """Text of this many characters, one byte each, within a range of codes (ISO 8859-1), without those that end it."""
    allowed = bytes(range(lowest, highest + 1)).translate(None, size.end if isinstance(size, Until) else b"")

    def parse(found: bytes) -> str:
        if found.translate(None, allowed):
            raise ValueError(f"{found!r} holds a character outside {lowest:02X}H to {highest:02X}H")
        return found.decode("latin-1")

    def write(text: str) -> bytes:
        if not isinstance(text, str):
            raise TypeError(f"{text!r} is not text")
        data = text.encode("latin-1")
        parse(data)
        return data

    said = emission.text(size, allowed)
    return Leaf(size, parse, write, meaning=meaning, alphabet=allowed, emission=said)


def _listed_numbers(numbers: range, allowed: Container[int] | None, *, few: bool) -> Sequence[int] | None:
    """Return all that a number can be, None where nobody said so and they are not few."""
    if allowed is None:
        return numbers if few else None
    return [each for each in (allowed if isinstance(allowed, Iterable) else numbers) if each in numbers]


_BINARY = {1: "B", 2: "H", 4: "I", 8: "Q"}


def unsigned(size: int, meaning: str = "", *, allowed: Container[int] | None = None) -> Leaf:
    """An unsigned binary number, high byte first, of those that are allowed."""
    return _binary(size, range(256**size), meaning, allowed, signed=False)


def signed(size: int, meaning: str = "", *, allowed: Container[int] | None = None) -> Leaf:
    """A two's complement binary number, high byte first, of those that are allowed."""
    return _binary(size, range(-(256**size) // 2, 256**size // 2), meaning, allowed, signed=True)


def _binary(size: int, numbers: range, meaning: str, allowed: Container[int] | None, *, signed: bool) -> Leaf:
    letter = _BINARY.get(size, "")
    permitted = numbers if allowed is None else allowed
    return Leaf(
        size,
        lambda found: _within(int.from_bytes(found, "big", signed=signed), permitted),
        lambda value: _within(value, permitted).to_bytes(size, "big", signed=signed),
        meaning=meaning,
        values=_listed_numbers(numbers, allowed, few=False),
        emission=emission.number(letter.lower() if signed else letter, allowed) if letter else None,
    )


def filler(written: bytes, meaning: str = "") -> Leaf:
    """Characters that are not looked at when read and always written alike."""
    filling = Leaf(
        len(written),
        lambda _: None,
        lambda _: written,
        meaning=meaning or "not looked at",
        emission=emission.fixed(written, must_be=False),
    )
    filling.implied = True
    return filling


def unsure(leaf: Leaf, meaning: str = "") -> Leaf:
    """Like another leaf; what that may not hold reads as None, and None is written as spaces."""

    def parse(found: bytes) -> Any:
        try:
            return leaf.take_at(0, len(found), found)
        except Fault:
            return None

    def write(value: Any) -> bytes:
        return b" " * leaf.size if value is None else leaf.write_behind(b"", value)

    return Leaf(leaf.size, parse, write, meaning=meaning or leaf.meaning)


class Check(Leaf):
    """Check characters over everything from the byte at `start` up to themselves.

    off: characters that stand for a telegram without a check; they are taken when read, and written when they are
    given as this leaf's value. also: a second rule, by which some drives compute; its characters are taken when read.
    """

    implied = True

    def __init__(
        self,
        size: int,
        start: int,
        compute: Callable[[bytes], bytes],
        *,
        off: bytes | None = None,
        also: Callable[[bytes], bytes] | None = None,
        meaning: str = "",
    ) -> None:
        said = emission.as_they_are(size)
        super().__init__(size, lambda data: data, compute, category="checksum", meaning=meaning, emission=said)
        self.start = start
        self.off = off
        self.also = also
        self.compute = compute

    def take_at(self, place: int, size: int, data: bytes) -> bytes:
        """Read the check characters and compare them; returns them as found."""
        if fault := self.fault_at(place, size, data):
            raise fault
        return data[place : place + size]

    def fault_at(self, place: int, size: int, data: bytes) -> Fault | None:
        """Return what is wrong with them."""
        found = data[place : place + size]
        if len(found) < size:
            return cut_off(size, found)
        covered = data[self.start : place]
        if (
            found == self.off
            or found == (computed := self._write(covered))
            or (self.also and found == self.also(covered))
        ):
            return None
        return Fault("checksum", f"check characters {found!r} found, {computed!r} computed")

    @cached_property
    def alphabets(self) -> Sequence[Collection[int]]:
        """The characters that may stand at each of its places, as seen from all texts of one character."""
        rules = [self.compute] if self.also is None else [self.compute, self.also]
        texts = [*(rule(each) for rule in rules for each in ONE_CHARACTER), self.off or self.compute(b"")]
        return [{text[place] for text in texts} for place in range(self.size)]

    def write_behind(self, before: bytes, value: Any, context: Any = None) -> bytes:
        """Return the check characters for what stands before them, or those that switch the check off."""
        return value if self.off is not None and value == self.off else self._write(before[self.start :])


def xor_byte(covered: bytes) -> bytes:
    """Exclusive-or of all bytes, as one byte."""
    return ONE_CHARACTER[reduce(xor, covered, 0)]


def hex_sum(covered: bytes) -> bytes:
    """Low eight bits of the sum of all bytes, as two upper-case hexadecimal digits."""
    return _HEX_PAIRS[sum(covered) & 0xFF]


def decimal_sum(covered: bytes) -> bytes:
    """Last two decimal digits of the sum of all bytes, tens first."""
    return _DECIMAL_PAIRS[sum(covered) % 100]


_HEX_PAIRS = tuple(b"%02X" % value for value in range(256))
_DECIMAL_PAIRS = tuple(b"%02d" % value for value in range(100))
