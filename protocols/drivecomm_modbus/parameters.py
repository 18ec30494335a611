"""Parameters of Modbus drives: where they are, what their registers mean.

An address is what the manual prints, decimal or `0x...`: `40001`, `0x2000`; `i2103` an input register, `c65` a coil,
`d3` a discrete input. `.low`, `.high` and `.0` to `.15` are a byte or a bit of a register, which can only be read.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivecomm.errors import NotSupported, ParameterAddressError, UsageError
from drivecomm.protocol import WORD_TYPES, WordFormat

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivecomm.protocol import Model, ParameterInfo, Reading, Value
    from drivecomm_modbus.options import ModbusOptions

_ADDRESS = re.compile(r"([icd]?)(0x[0-9A-Fa-f]{1,6}|[0-9]{1,7})(?:\.(low|high|[0-9]|1[0-5]))?", re.ASCII)


@dataclass(frozen=True, slots=True)
class Place:
    """Where something stands.

    kind: empty for a holding register, i input register, c coil, d discrete input. start: its address in a telegram.
    part: low, high or a bit of the register, empty for all of it.
    """

    kind: str
    start: int
    part: str = ""

    @classmethod
    def named(cls, name: str) -> Place:
        """Return the whole register, or the coil, that has this name."""
        kind = name[0] if name[0] in "icd" else ""
        return cls(kind, int(name.removeprefix(kind)))

    @property
    def name(self) -> str:
        """The register, or the coil, in one word; the same for all of its parts."""
        return f"{self.kind}{self.start}"

    @property
    def is_bit(self) -> bool:
        """Whether it is a coil or a discrete input."""
        return self.kind in ("c", "d")

    @property
    def bits(self) -> tuple[int, int]:
        """The mask of this part of a register, and how far up it is."""
        if not self.part.isdigit():
            return {"low": (0xFF, 0), "high": (0xFF, 8), "": (0xFFFF, 0)}[self.part]
        return 1, int(self.part)

    def cut(self, word: int) -> int:
        """Return this part of a register."""
        mask, shift = self.bits
        return word >> shift & mask

    def put(self, word: int, value: int) -> int:
        """Return a register with this part set."""
        mask, shift = self.bits
        return word & ~(mask << shift) | (value & mask) << shift


def place_of(address: str, options: ModbusOptions) -> Place:
    """Return where an address as the manual prints it is. Raises ParameterAddressError."""
    found = _ADDRESS.fullmatch(address) if isinstance(address, str) else None
    if found is None or (found[3] and found[1] in ("c", "d")):
        raise ParameterAddressError(
            f"{address!r} is no address of a Modbus drive; write 40001, 0x2000, i2103 (input register), c65 (coil) or "
            "0x2100.low"
        )
    base = options.coil_base if found[1] in ("c", "d") else options.register_base
    start = int(found[2], 0 if found[2].startswith("0x") else 10) - base
    if not 0 <= start <= 0xFFFF:
        raise ParameterAddressError(f"{address} is not {base} to {base + 0xFFFF}, the registers of this drive")
    return Place(found[1], start, found[3] or "")


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """A parameter to be read or written. wide: 32 bits under one address. name: the one that was asked for."""

    address: str
    place: Place
    format: WordFormat
    wide: bool
    info: ParameterInfo | None
    name: str

    @property
    def end(self) -> int:
        """The first register, or coil, after it."""
        return self.place.start + (1 if self.wide else self.format.size)

    @property
    def spots(self) -> tuple[str, ...]:
        """The registers, or the coil, by name."""
        return tuple(f"{self.place.kind}{start}" for start in range(self.place.start, self.end))

    def raw_of(self, words: Sequence[int]) -> int | str:
        """Return the unsigned number, or the text, that these registers hold."""
        return self.place.cut(words[0]) if self.place.part else self.format.raw_of(words)

    def reading(self, raw: int | str) -> Reading:
        """Return what a raw value means."""
        return self.format.reading(raw, self.address, self.info, self.name)

    def raw_for(self, value: Value | float, *, rounded: bool = False) -> int | str:
        """Return what is to be written. rounded: to the nearest step. Raises ValueRefusedError for a misfit."""
        if self.place.part or self.place.kind in ("i", "d"):
            raise NotSupported(f"{self.address} can only be read; whole registers and coils are written")
        return self.format.raw_for(value, self.address, self.info, rounded=rounded)


def target(parameter: str, model: Model | None, options: ModbusOptions, type: str = "") -> Target:
    """Return what is to be read or written. type: instead of the model's. Raises ParameterAddressError."""
    info = model.find(parameter) if model is not None else None
    place = place_of(info.address if info else parameter, options)
    if info is None and model is not None:
        # The same register may be written in another way: 8448 is 0x2100.
        info = next((each for each in model.parameters.values() if place_of(each.address, options) == place), None)
    kind = type or (info.type if info else "")
    if kind and kind not in WORD_TYPES:
        raise UsageError(f"{kind!r} is no type of a Modbus parameter; types are {', '.join(WORD_TYPES)}")
    extra = info.extra if info else {}
    low_first = extra.get("word_order", options.word_order) == "low"
    size = (int(extra.get("characters", 2)) + 1) // 2 if kind == "string" else 2 if kind.endswith("32") else 1
    base = options.coil_base if place.is_bit else options.register_base
    part = f".{place.part}" if place.part else ""
    return Target(
        address=info.address if info else f"{place.kind}{place.start + base}{part}",
        place=place,
        format=WordFormat(type=kind, size=size, low_first=low_first, allowed=range(2) if place.is_bit else None),
        wide=kind.endswith("32") and not place.kind and options.wide_functions,
        info=info,
        name=info.name if info and parameter == info.name else "",
    )


def blocks_of(wanted: Sequence[Target], options: ModbusOptions) -> list[list[int]]:
    """Return which of these one telegram reads, by their places in the list: neighbours, as many as a drive allows."""
    blocks: list[list[int]] = []
    start = end = 0
    for number in sorted(range(len(wanted)), key=lambda each: (wanted[each].place.kind, wanted[each].place.start)):
        each, before = wanted[number], wanted[blocks[-1][-1]] if blocks else None
        if (
            before is not None
            and not (each.wide or before.wide)
            and each.place.kind == before.place.kind
            and each.place.start - end <= options.bridged_registers
            and each.end - start <= options.max_registers
        ):
            blocks[-1].append(number)
            end = max(end, each.end)
        else:
            blocks.append([number])
            start, end = each.place.start, each.end
    return blocks
