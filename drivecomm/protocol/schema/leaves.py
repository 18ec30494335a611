"""Leaves for the usual parts of drive telegrams.

A telegram is a flat sequence of these leaves, named as construct names parts (`"address" / unsigned(1)`). Each leaf
reads and writes a number of characters and refuses invalid ones. It also provides Python code, from which the form
makes one function (see `compiled`). Construct is only the notation of the declaration, and reads and writes nothing
itself. Leaves with a name become fields of the message; nameless ones (constants, lengths, check characters) are filled
in when a telegram is built.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property, reduce
from operator import xor
from typing import TYPE_CHECKING, Any

from drivecomm.protocol.schema import emission
from drivecomm.protocol.schema.leaf import ONE_CHARACTER, Leaf, LeafFault, Until, cut_off

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Container, Mapping, Sequence


_DECIMAL, _HEX = b"0123456789", b"0123456789ABCDEF"

# Maximum digits of a number that is looked up; tables for more digits cost more memory than they are worth.
_LOOKED_UP = 2

# From this number on, an error lists only the first and the last of the allowed values.
_MANY = 12


class _Constant(Leaf):
    """Leaf with exactly these bytes."""

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
        """Raise LeafFault unless the telegram has these bytes at this place."""
        if fault := self.fault_at(place, size, data):
            raise fault

    def fault_at(self, place: int, size: int, data: bytes) -> LeafFault | None:
        """Return the fault, without raising it: most damage of telegrams is found here and in check characters."""
        found = data[place : place + size]
        if found == self._data:
            return None
        if len(found) < size:
            return cut_off(size, found)
        return LeafFault("framing", f"{self._shown} expected, {found.hex(' ').upper()} found")


def constant(data: bytes, meaning: str = "") -> Leaf:
    """Return a leaf with exactly these bytes; anything else is a framing error."""
    return _Constant(data, meaning)


def choice(values: Mapping[bytes, Any], meaning: str = "") -> Leaf:
    """Return a leaf with one of these byte strings of equal length, each of which stands for a value."""
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
    """Return a leaf with one of these whole numbers or texts.

    No two values are written alike, and all are written in the same number of characters.
    """
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
    """Return a leaf for an unsigned number in ASCII decimal digits, the most significant first.

    digits: the number of digits. allowed: the permitted numbers, None for all.
    """

    def parse(found: bytes) -> int:
        if not found.isdigit():
            raise ValueError(f"{found!r} are not {digits} decimal digits")
        return int(found)

    said = "not {0}.isdigit()", "int({0})", b"%%0%dd" % digits
    return _number_in_digits(_DECIMAL, digits, parse, said, allowed=allowed, meaning=meaning)


def hex_number(digits: int, meaning: str = "", *, allowed: Container[int] | None = None) -> Leaf:
    """Return a leaf for an unsigned number in upper-case hexadecimal ASCII digits, the most significant first.

    digits: the number of digits. allowed: the permitted numbers, None for all.
    """
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
    """Return a leaf for a number in digits.

    said: code that detects wrong digits, reads digits and writes them, for `emission.digits`.
    """
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
    """Return a leaf for upper-case hexadecimal digits that stay text.

    For values whose meaning depends on the number of digits.
    """

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
    """Return the number for upper-case hexadecimal digits. Raises ValueError for any other character."""
    if digits.translate(None, _HEX):
        raise ValueError(f"{digits.decode('latin-1')!r} is not made of the digits 0-9 and A-F")
    return int(digits, 16)


def shifted_character(base: int, allowed: Container[int], meaning: str = "") -> Leaf:
    """Return a leaf for a number in one character, whose code is `base` plus the number."""

    def parse(found: bytes) -> int:
        return _within(found[0] - base, allowed)

    values = [number for number in range(-base, 256 - base) if number in allowed]
    return Leaf(1, parse, lambda value: bytes([base + _within(value, allowed)]), meaning=meaning, values=values)


def characters(size: Any, *, lowest: int = 0x20, highest: int = 0x7E, meaning: str = "") -> Leaf:
    """Return a leaf for text of this size, one byte for each character, within a range of codes (ISO 8859-1).

    The bytes of the constant that ends the text are excluded from the range.
    """
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
    """Return all possible values of a number; None if they are not restricted and not few."""
    if allowed is None:
        return numbers if few else None
    return [each for each in (allowed if isinstance(allowed, Iterable) else numbers) if each in numbers]


_BINARY = {1: "B", 2: "H", 4: "I", 8: "Q"}


def unsigned(size: int, meaning: str = "", *, allowed: Container[int] | None = None) -> Leaf:
    """Return a leaf for an unsigned binary number, high byte first.

    size: the number of bytes. allowed: the permitted numbers, None for all.
    """
    return _binary(size, range(256**size), meaning, allowed, signed=False)


def signed(size: int, meaning: str = "", *, allowed: Container[int] | None = None) -> Leaf:
    """Return a leaf for a two's complement binary number, high byte first.

    size: the number of bytes. allowed: the permitted numbers, None for all.
    """
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
    """Return a leaf for characters that are ignored when read and always written alike."""
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
    """Return a leaf like another one, which reads invalid content as None and writes None as spaces."""

    def parse(found: bytes) -> Any:
        try:
            return leaf.take_at(0, len(found), found)
        except LeafFault:
            return None

    def write(value: Any) -> bytes:
        return b" " * leaf.size if value is None else leaf.write_behind(b"", value)

    return Leaf(leaf.size, parse, write, meaning=meaning or leaf.meaning)


class CheckCharacters(Leaf):
    """Check characters over all bytes from the byte at `start` up to themselves.

    off: characters that stand for a telegram without a check; they are accepted when read, and written if they are
    given as the value of this leaf. also: a second rule, by which some drives compute; its characters are accepted when
    read.
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
        """Return the check characters as found. Raises LeafFault if they are wrong."""
        if fault := self.fault_at(place, size, data):
            raise fault
        return data[place : place + size]

    def fault_at(self, place: int, size: int, data: bytes) -> LeafFault | None:
        """Return the fault of the check characters; None if they are right."""
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
        return LeafFault("checksum", f"check characters {found!r} found, {computed!r} computed")

    @cached_property
    def alphabets(self) -> Sequence[Collection[int]]:
        """Characters that may occur at each place, as computed for all byte strings of one character."""
        rules = [self.compute] if self.also is None else [self.compute, self.also]
        texts = [*(rule(each) for rule in rules for each in ONE_CHARACTER), self.off or self.compute(b"")]
        return [{text[place] for text in texts} for place in range(self.size)]

    def write_behind(self, before: bytes, value: Any, context: Any = None) -> bytes:
        """Return the check characters for the characters before them, or those that switch the check off."""
        return value if self.off is not None and value == self.off else self._write(before[self.start :])


def xor_byte(covered: bytes) -> bytes:
    """Return the exclusive-or of all bytes, as one byte."""
    return ONE_CHARACTER[reduce(xor, covered, 0)]


def hex_sum(covered: bytes) -> bytes:
    """Return the low eight bits of the sum of all bytes, as two upper-case hexadecimal digits."""
    return _HEX_PAIRS[sum(covered) & 0xFF]


def decimal_sum(covered: bytes) -> bytes:
    """Return the last two decimal digits of the sum of all bytes, tens first."""
    return _DECIMAL_PAIRS[sum(covered) % 100]


_HEX_PAIRS = tuple(b"%02X" % value for value in range(256))
_DECIMAL_PAIRS = tuple(b"%02d" % value for value in range(100))
