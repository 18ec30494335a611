"""Registers and coils: the places of parameters, and the parameters that one telegram can read together."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, cast

from drivecomm.errors import NotSupported

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from drivecomm.protocol import ParameterInfo, Reading, Value, WordFormat


@dataclass(frozen=True, slots=True)
class Place:
    """Place of a value: a register, a coil, or a part of a register.

    kind: letters, empty for a holding register; i is an input register, c a coil, d a discrete input. i and d are only
    read; other letters belong to a protocol. start: its number in a telegram. part: low, high or the number of a bit of
    the register, empty for all of it.
    """

    kind: str
    start: int
    part: str = ""

    @classmethod
    def named(cls, name: str) -> Place:
        """Return the whole register or coil that has this name."""
        kind = name.rstrip("0123456789")
        return cls(kind, int(name.removeprefix(kind)))

    @property
    def name(self) -> str:
        """Name of the register or coil, in one word; the same for all parts of a register."""
        return f"{self.kind}{self.start}"

    @property
    def is_bit(self) -> bool:
        """Whether this is a coil or a discrete input."""
        return self.kind in ("c", "d")

    @property
    def bits(self) -> tuple[int, int]:
        """The mask of this part of a register before shifting, and the number of its lowest bit."""
        if not self.part.isdigit():
            return {"low": (0xFF, 0), "high": (0xFF, 8), "": (0xFFFF, 0)}[self.part]
        return 1, int(self.part)

    def cut(self, word: int) -> int:
        """Return this part of a register; a whole register may have more than 16 bits."""
        if not self.part:
            return word
        mask, shift = self.bits
        return word >> shift & mask

    def put(self, word: int, value: int) -> int:
        """Return a register with this part set to a value."""
        if not self.part:
            return value
        mask, shift = self.bits
        return word & ~(mask << shift) | (value & mask) << shift


# Cached, since a virtual drive needs the names for all its parameters at each telegram.
@lru_cache(maxsize=4096)
def _names(kind: str, start: int, end: int) -> tuple[str, ...]:
    return tuple(f"{kind}{each}" for each in range(start, end))


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """A parameter in registers or in a coil.

    wide: whether 32 bits, or a whole text, are under one address. name: the name that was requested.
    """

    address: str
    place: Place
    format: WordFormat
    wide: bool
    info: ParameterInfo | None
    name: str

    @property
    def alone(self) -> bool:
        """Whether no telegram reads it together with others: another parameter holds its decimals, or it is wide."""
        return self.wide or (self.info is not None and "decimals" in self.info.extra)

    @property
    def end(self) -> int:
        """Number of the first register or coil after it."""
        return self.place.start + (1 if self.wide else self.format.size)

    @property
    def spots(self) -> tuple[str, ...]:
        """Names of its registers, or of its coil."""
        return _names(self.place.kind, self.place.start, self.end)

    @property
    def room(self) -> range:
        """The unsigned numbers that fit into its place."""
        if self.place.part:
            return range(self.place.bits[0] + 1)
        return self.format.allowed or range(1 << (32 if self.wide or self.format.size == 2 else 16))

    def raw_of(self, words: Sequence[int]) -> int | str:
        """Return the unsigned number or the text in these registers."""
        if self.wide:
            return words[0]
        return self.place.cut(words[0]) if self.place.part else self.format.raw_of(words)

    def raw_in(self, words: Sequence[int], first: Place) -> int | str:
        """Return the raw value of this parameter from registers that were read from a place on."""
        return self.raw_of(words[self.place.start - first.start : self.end - first.start])

    def words_for(self, raw: int | str, before: int) -> tuple[int, ...]:
        """Return the registers that hold a raw value.

        before: the previous content of the first register, of which this parameter may be a part.
        """
        if self.place.part:
            return (self.place.put(before, int(raw)),)
        return (cast("int", raw),) if self.wide else self.format.words_of(raw)

    def reading(self, raw: int | str) -> Reading:
        """Return the reading for a raw value."""
        return self.format.reading(raw, self.address, self.info, self.name)

    def raw_for(self, value: Value | float, *, rounded: bool = False) -> int | str:
        """Return the raw value to write for a physical value. Raises ValueRefusedError if there is none.

        rounded: whether a value between two steps is rounded to the nearest step.
        """
        if self.place.part or self.place.kind in ("i", "d"):
            raise NotSupported(f"{self.address} can only be read; whole registers and coils are written")
        return self.format.raw_for(value, self.address, self.info, rounded=rounded)


def span_of(wanted: Sequence[Target]) -> tuple[Place, int]:
    """Return the first place and the number of the registers that hold all these parameters."""
    first = min((each.place for each in wanted), key=lambda place: place.start)
    return Place(first.kind, first.start), max(each.end for each in wanted) - first.start


def blocks_of(wanted: Sequence[Target], *, most: int, bridged: int, whole: Collection[str] = ()) -> list[list[int]]:
    """Return groups of parameters that one telegram reads, as positions in the list.

    most: the maximum number of registers in one telegram. bridged: the maximum number of unneeded registers between two
    parameters. whole: kinds of place that one telegram always reads completely.
    """
    blocks: list[list[int]] = []
    start = end = 0
    for number in sorted(range(len(wanted)), key=lambda each: (wanted[each].place.kind, wanted[each].place.start)):
        each, before = wanted[number], wanted[blocks[-1][-1]] if blocks else None
        if (
            before is not None
            and not (each.alone or before.alone)
            and each.place.kind == before.place.kind
            and (each.place.kind in whole or (each.place.start - end <= bridged and each.end - start <= most))
        ):
            blocks[-1].append(number)
            end = max(end, each.end)
        else:
            blocks.append([number])
            start, end = each.place.start, each.end
    return blocks
