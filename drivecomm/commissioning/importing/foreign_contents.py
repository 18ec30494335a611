"""Contents of a foreign file: its registers, and everything that a model cannot express or the import cannot read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from typing import TYPE_CHECKING, Any

from drivecomm.errors import UsageError
from drivecomm.protocol import LineSettings

if TYPE_CHECKING:
    from collections.abc import Iterator

_LONGEST_WORD = 60
MOST = 0xFFFF
"""Highest address of a register or coil in a telegram (Modbus application protocol 4.4)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ForeignRegister:
    """Register or coil in a foreign file.

    place: position in the file. title: name in the file. kind: empty for a holding register, i input register, c coil,
    d discrete input. number: as in a telegram, from 0. part: low, high or a bit of the register. type: type name of
    Modbus drive models, empty for a part or a coil. unit, factor, values: as in a model. word_order: high or low, empty
    if the file does not state it. characters: length of a text. written: the file only writes this register. drive:
    address of the drive, None if the file names none. counted: the number as printed in the file, if it differs from
    that of the telegram.
    """

    place: str
    title: str
    number: int
    kind: str = ""
    part: str = ""
    type: str = "u16"
    unit: str = ""
    factor: Decimal = Decimal(1)
    values: Mapping[int, str] = field(default_factory=dict)
    word_order: str = ""
    characters: int = 0
    written: bool = False
    drive: int | None = None
    counted: str = ""

    @property
    def address(self) -> str:
        """Address of the register in a model that counts registers from 0."""
        shown = str(self.number) if self.number <= 0xFF or self.counted.isdecimal() else f"0x{self.number:04X}"
        return f"{self.kind}{shown}{f'.{self.part}' if self.part else ''}"


@dataclass(frozen=True, slots=True)
class OmittedItem:
    """Item of the file that is missing in the model. place: line or key. what: text of the item. reason: why."""

    place: str
    what: str
    reason: str

    def __str__(self) -> str:
        return f"{self.place}: {self.what}: {self.reason}" if self.what else f"{self.place}: {self.reason}"


@dataclass(slots=True, kw_only=True)
class ForeignContents:
    """Contents of one foreign file.

    form: kind of file, for display. title: name of the drives, if the file has one. options: line settings of a Modbus
    drive. columns: for a list, the heading of each recognised column. assumptions: assumptions that the user should
    confirm, as sentences. port: the port to the drive, empty if the file does not name it.
    """

    form: str
    title: str = ""
    port: str = ""
    registers: list[ForeignRegister] = field(default_factory=list)
    left: list[OmittedItem] = field(default_factory=list)
    assumptions: list[str] = field(default_factory=list)
    columns: dict[str, str] = field(default_factory=dict)
    options: dict[str, Any] = field(default_factory=dict)

    def leave(self, place: str, what: object, reason: str) -> None:
        """Record an item that is not imported."""
        self.left.append(OmittedItem(place, "" if what is None else str(what), reason))

    def assume(self, sentence: str) -> None:
        """Record an assumption, once."""
        if sentence not in self.assumptions:
            self.assumptions.append(sentence)

    def take_line(self, place: str, given: Mapping[str, Any]) -> None:
        """Import line settings, by the option names of a Modbus drive; record other items as not imported."""
        for option, value in given.items():
            word = str(value).strip()[:_LONGEST_WORD]
            setting: Any = word[:1].upper() if option == "parity" else int(word) if word.isdecimal() else word
            try:
                LineSettings(**{option: setting})
            except UsageError:
                self.leave(place, f"{option} {word}", "not a line setting of a Modbus drive")
            else:
                self.options[option] = setting

    def tables(self, place: str, value: object) -> Iterator[tuple[str, Mapping[str, Any]]]:
        """Yield the tables of a list, each with its place; record every other item as not imported."""
        if value is None or value == "":
            return
        for number, each in enumerate(value if isinstance(value, list) else [value]):
            if isinstance(each, Mapping):
                yield f"{place}[{number}]", each
            else:
                self.leave(f"{place}[{number}]", str(each)[:_LONGEST_WORD], "not an entry with keys")

    def add(self, register: ForeignRegister) -> None:
        """Add a register; record one whose number does not fit into a telegram as not imported."""
        if not 0 <= register.number <= MOST:
            self.leave(register.place, register.number, f"a telegram names registers from 0 to {MOST}")
            return
        if register.type.endswith("32") and not register.word_order:
            self.assume(
                "32-bit values have their high word in the lower register, because the file gives no word order"
            )
        self.registers.append(register)
