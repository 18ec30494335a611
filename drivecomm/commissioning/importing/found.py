"""What was found in a file of another program: its registers, and what a model cannot say or nobody understood."""

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
"""The highest address of a register or coil in a telegram (Modbus application protocol 4.4)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ForeignRegister:
    """A register or coil that a file names.

    place: where in the file. title: what the file calls it. kind: empty for a holding register, i input register, c
    coil, d discrete input. number: as it stands in a telegram, from 0. part: low, high or a bit of the register. type:
    as models of Modbus drives call it, empty for a part or a coil. unit, factor, values: as in a model. word_order:
    high or low, empty where the file does not say it. characters: of a text. written: the file only writes there.
    drive: the address of the drive that is asked, None where the file names none. counted: how the file prints the
    number, where that is not how a telegram has it.
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
        """The address in a model whose registers are counted from 0."""
        shown = str(self.number) if self.number <= 0xFF or self.counted.isdecimal() else f"0x{self.number:04X}"
        return f"{self.kind}{shown}{f'.{self.part}' if self.part else ''}"


@dataclass(frozen=True, slots=True)
class NotCarried:
    """Something of the file that the model does not say. place: line or key. what: as it stands there. reason: why."""

    place: str
    what: str
    reason: str

    def __str__(self) -> str:
        return f"{self.place}: {self.what}: {self.reason}" if self.what else f"{self.place}: {self.reason}"


@dataclass(slots=True, kw_only=True)
class Foreign:
    """What was found in one file.

    form: what the file is, for people. title: of the drives, as far as the file says it. options: line settings of a
    Modbus drive. columns: for a list, the heading of each column that was understood. assumptions: what was taken for
    granted and is to be confirmed, in sentences. port: where the file reaches the drive, empty if it does not say.
    """

    form: str
    title: str = ""
    port: str = ""
    registers: list[ForeignRegister] = field(default_factory=list)
    left: list[NotCarried] = field(default_factory=list)
    assumptions: list[str] = field(default_factory=list)
    columns: dict[str, str] = field(default_factory=dict)
    options: dict[str, Any] = field(default_factory=dict)

    def leave(self, place: str, what: object, reason: str) -> None:
        """List something that is not carried over."""
        self.left.append(NotCarried(place, "" if what is None else str(what), reason))

    def assume(self, sentence: str) -> None:
        """Note an assumption, once."""
        if sentence not in self.assumptions:
            self.assumptions.append(sentence)

    def take_line(self, place: str, given: Mapping[str, Any]) -> None:
        """Take over line settings, by the names of the options of a Modbus drive; what is not one of them is listed."""
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
        """Yield the tables of a list, each with its place; anything else in it, or in place of it, is listed."""
        if value is None or value == "":
            return
        for number, each in enumerate(value if isinstance(value, list) else [value]):
            if isinstance(each, Mapping):
                yield f"{place}[{number}]", each
            else:
                self.leave(f"{place}[{number}]", str(each)[:_LONGEST_WORD], "not an entry with keys")

    def add(self, register: ForeignRegister) -> None:
        """Add a register; one beyond what a telegram can name is listed instead."""
        if not 0 <= register.number <= MOST:
            self.leave(register.place, register.number, f"a telegram names registers from 0 to {MOST}")
            return
        if register.type.endswith("32") and not register.word_order:
            self.assume("32-bit values have their high word in the lower register, because the file says no word order")
        self.registers.append(register)
