"""The vocabulary of telegram schemas: construct leaves for what drive telegrams are made of.

A telegram is one flat `construct.Struct` of these leaves. Each leaf reads and writes a number of characters and
refuses what it may not hold, and can say so in Python, for the form to make one function of them (see `compiled`).
Leaves with a name become fields of the message; nameless ones (constants, lengths, check characters) are filled in
when a telegram is built.
"""

from __future__ import annotations

from functools import reduce
from operator import xor
from typing import TYPE_CHECKING, Any

from construct import Construct

from drivecomm.protocol.schema import emission

if TYPE_CHECKING:
    from collections.abc import Callable, Container, Iterable, Mapping

    from drivecomm.errors import Category
    from drivecomm.protocol.schema.emission import Emission

GRAVITY: tuple[Category, ...] = ("length", "framing", "checksum", "field")
"""What can be wrong with a telegram, the gravest first: noise is never called a wrong value."""

_HEX = b"0123456789ABCDEF"

# Digits of a number that is looked up; the tables of longer ones would take more memory than they save time.
_LOOKED_UP = 2

# So many values are not listed in an error.
_MANY = 12


class Fault(Exception):  # noqa: N818 - never leaves this package, the form turns it into a TelegramError
    """One leaf could not be read or written; field is its name, empty where nobody named it."""

    def __init__(self, category: Category, message: str, field: str = "") -> None:
        self.category: Category = category
        self.field = field
        super().__init__(message)


def _cut(size: int, found: bytes) -> Fault:
    return Fault("length", f"{size} characters expected, {len(found)} left")


def _name_in(path: str) -> str:
    """Return the leaf's name from the path that construct hands down, such as "(parsing) -> address"."""
    return path.partition(" -> ")[2]


if TYPE_CHECKING:
    _Construct = Construct[Any, Any]
else:
    _Construct = Construct


class Leaf(_Construct):
    """Characters of a known number that mean one value.

    size: number of bytes, or a construct expression over fields read before. parse: bytes to value. write: value to
    bytes. Both raise ValueError for what may not be, and depend on nothing but what they are given. category: what a
    wrong content is called. meaning: for the docs. values: all values that there are, whole numbers or texts, where
    they are few enough to be looked up instead, and each is written in one way only. emission: how the leaf is said in
    code; found from the rest unless given.
    """

    def __init__(
        self,
        size: Any,
        parse: Callable[[bytes], Any],
        write: Callable[[Any], bytes],
        *,
        category: Category = "field",
        meaning: str = "",
        values: Iterable[Any] | None = None,
        emission: Emission | None = None,
    ) -> None:
        super().__init__()
        self.size = size
        self.category: Category = category
        self.meaning = meaning
        self.emission = emission or _emission(size, parse, write, values)
        self._parse_found = parse
        self._write = write

    def take(self, stream: Any, context: Any) -> Any:
        """Read this leaf from the stream."""
        size, place = self.size_in(context), stream.tell()
        stream.read(size)
        return self.take_at(place, size, stream.getvalue())

    def take_at(self, place: int, size: int, data: bytes) -> Any:
        """Read this leaf, of this size, at a place of a telegram."""
        found = data[place : place + size]
        if len(found) < size:
            raise _cut(size, found)
        try:
            return self._parse_found(found)
        except ValueError as error:
            raise Fault(self.category, str(error)) from None

    def fault_at(self, place: int, size: int, data: bytes) -> Fault | None:
        """Return what is wrong with this leaf, of this size, at a place of a telegram."""
        try:
            self.take_at(place, size, data)
        except Fault as fault:
            return fault
        return None

    def _parse(self, stream: Any, context: Any, path: str) -> Any:
        try:
            return self.take(stream, context)
        except Fault as fault:
            fault.field = _name_in(path)
            context._params.faults.append(fault)  # noqa: SLF001 - construct's documented place for parse arguments
            return None

    def _build(self, obj: Any, stream: Any, context: Any, path: str) -> Any:
        try:
            data = self._write(obj)
        except (ValueError, TypeError) as error:
            raise Fault("field", "it is missing" if obj is None else str(error), _name_in(path)) from None
        size = self.size_in(context)
        if len(data) != size:
            raise Fault("field", f"{len(data)} characters where {size} belong", _name_in(path))
        stream.write(data)
        return obj

    def _sizeof(self, context: Any, path: str) -> int:
        return self.size_in(context)

    def size_in(self, context: Any) -> int:
        """Return how many characters it has, given the fields before it."""
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


def _emission(
    size: Any, parse: Callable[[bytes], Any], write: Callable[[Any], bytes], values: Iterable[Any] | None
) -> Emission | None:
    if not isinstance(size, int):
        return None
    if values is None:
        return emission.called(size, parse, write)
    return emission.enumerated(size, values, type(next(iter(values), 0)), write)


class _Implied(Leaf):
    """A leaf that needs no value to be built."""

    def __init__(self, *arguments: Any, **keywords: Any) -> None:
        super().__init__(*arguments, **keywords)
        self.flagbuildnone = True


class _Constant(_Implied):
    """Exactly these bytes."""

    def __init__(self, data: bytes, meaning: str) -> None:
        shown = data.hex(" ").upper()
        said = emission.fixed(data, must_be=True)
        super().__init__(
            len(data), lambda _: None, lambda _: data, category="framing", meaning=meaning or shown, emission=said
        )
        self._data, self._shown = data, f"{shown} {meaning}"

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
            return _cut(size, found)
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

    return Leaf(size, parse, write, meaning=meaning, emission=emission.looked_up(values))


def _listed(values: Iterable[Any]) -> str:
    shown = [*values]
    return ", ".join(map(repr, shown) if len(shown) < _MANY else [repr(shown[0]), "...", repr(shown[-1])])


def _within(value: Any, allowed: Container[int]) -> int:
    if type(value) is not int or value not in allowed:
        raise ValueError(f"{value!r} is not allowed here")
    return value


def decimal_number(digits: int, allowed: Container[int] | None = None, meaning: str = "") -> Leaf:
    """An unsigned number in this many ASCII decimal digits, most significant first."""
    permitted = range(10**digits) if allowed is None else allowed

    def parse(found: bytes) -> int:
        if not found.isdigit():
            raise ValueError(f"{found!r} are not {digits} decimal digits")
        return _within(int(found), permitted)

    def write(value: Any) -> bytes:
        return b"%0*d" % (digits, _within(value, permitted))

    if digits <= _LOOKED_UP:
        values = [value for value in range(10**digits) if value in permitted]
        return Leaf(digits, parse, write, meaning=meaning, values=values)
    layout = b"%%0%dd" % digits
    said = emission.digits(digits, "not {0}.isdigit()", "int({0})", layout, permitted)
    return Leaf(digits, parse, write, meaning=meaning, emission=said)


def hex_number(digits: int, meaning: str = "") -> Leaf:
    """An unsigned number in this many upper-case hexadecimal ASCII digits, most significant first."""
    permitted = range(16**digits)

    def write(value: Any) -> bytes:
        return b"%0*X" % (digits, _within(value, permitted))

    if digits <= _LOOKED_UP:
        return Leaf(digits, hex_value, write, meaning=meaning, values=permitted)
    wrong, layout = f"{{0}}.translate(None, {_HEX!r})", b"%%0%dX" % digits
    said = emission.digits(digits, wrong, "int({0}, 16)", layout, permitted)
    return Leaf(digits, hex_value, write, meaning=meaning, emission=said)


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
    """Text of this many characters, one byte each, within a range of codes (ISO 8859-1)."""
    allowed = bytes(range(lowest, highest + 1))

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
    return Leaf(size, parse, write, meaning=meaning, emission=said)


_BINARY = {1: "B", 2: "H", 4: "I", 8: "Q"}


def unsigned(size: int, meaning: str = "") -> Leaf:
    """An unsigned binary number, high byte first."""
    return _binary(size, range(256**size), meaning, signed=False)


def signed(size: int, meaning: str = "") -> Leaf:
    """A two's complement binary number, high byte first."""
    return _binary(size, range(-(256**size) // 2, 256**size // 2), meaning, signed=True)


def _binary(size: int, permitted: range, meaning: str, *, signed: bool) -> Leaf:
    letter = _BINARY.get(size, "")
    return Leaf(
        size,
        lambda found: int.from_bytes(found, "big", signed=signed),
        lambda value: _within(value, permitted).to_bytes(size, "big", signed=signed),
        meaning=meaning,
        emission=emission.number(letter.lower() if signed else letter) if letter else None,
    )


def filler(written: bytes, meaning: str = "") -> Leaf:
    """Characters that are not looked at when read and always written alike."""
    return _Implied(
        len(written),
        lambda _: None,
        lambda _: written,
        meaning=meaning or "not looked at",
        emission=emission.fixed(written, must_be=False),
    )


def unsure(leaf: Leaf, meaning: str = "") -> Leaf:
    """Like another leaf; what that may not hold reads as None, and None is written as spaces."""

    def parse(found: bytes) -> Any:
        try:
            return leaf.take_at(0, len(found), found)
        except Fault:
            return None

    def write(value: Any) -> bytes:
        return b" " * leaf.size if value is None else leaf._write(value)  # noqa: SLF001 - same vocabulary

    return Leaf(leaf.size, parse, write, meaning=meaning or leaf.meaning)


class Check(Leaf):
    """Check characters over everything from the byte at `start` up to themselves.

    off: characters that stand for a telegram without a check; they are taken when read, and written when they are
    given as this leaf's value.
    """

    def __init__(
        self, size: int, start: int, compute: Callable[[bytes], bytes], *, off: bytes | None = None, meaning: str = ""
    ) -> None:
        said = emission.as_they_are(size)
        super().__init__(size, lambda data: data, compute, category="checksum", meaning=meaning, emission=said)
        self.flagbuildnone = True
        self.start = start
        self.off = off
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
            return _cut(size, found)
        if found == self.off or found == (computed := self._write(data[self.start : place])):
            return None
        return Fault("checksum", f"check characters {found!r} found, {computed!r} computed")

    def _build(self, obj: Any, stream: Any, context: Any, path: str) -> Any:
        switched_off = self.off is not None and obj == self.off
        data = obj if switched_off else self._write(stream.getvalue()[self.start :])
        stream.write(data)
        return data


KINDS = (Leaf, _Implied, _Constant, Check)
"""The leaves whose emissions say all that they do; one derived from them may read and write in its own way."""


def xor_byte(covered: bytes) -> bytes:
    """Exclusive-or of all bytes, as one byte."""
    return _BYTES[reduce(xor, covered, 0)]


def hex_sum(covered: bytes) -> bytes:
    """Low eight bits of the sum of all bytes, as two upper-case hexadecimal digits."""
    return _HEX_PAIRS[sum(covered) & 0xFF]


def decimal_sum(covered: bytes) -> bytes:
    """Last two decimal digits of the sum of all bytes, tens first."""
    return _DECIMAL_PAIRS[sum(covered) % 100]


_BYTES = tuple(bytes([value]) for value in range(256))
_HEX_PAIRS = tuple(b"%02X" % value for value in range(256))
_DECIMAL_PAIRS = tuple(b"%02d" % value for value in range(100))
