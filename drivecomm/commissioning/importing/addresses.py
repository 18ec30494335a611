"""Register numbering of a list: from 0 as in telegrams, from 1, or in the style of Modicon."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Literal, NamedTuple, TypeAlias, cast

if TYPE_CHECKING:
    from collections.abc import Iterable

Base: TypeAlias = Literal["0", "1", "modicon"]
"""Number that a list gives to the register with telegram address 0: 0, 1, or 40001 and 30001 (Modicon PI-MBUS-300)."""

_KINDS = {"0": "c", "1": "d", "3": "i", "4": ""}
"""First digit of a Modicon number: coils, discrete inputs, input registers, holding registers."""

_HEX = re.compile(r"(?:0x|&h|#|\$)\s*([0-9a-f]+)|([0-9a-f]+)\s*h", re.IGNORECASE)
_DECIMAL = re.compile(r"\d+")
_MODICON = re.compile(r"([0134](?!x)|[134]x|[0134]:)\s*(\d{4,5})", re.IGNORECASE)
_MARKED = re.compile(r"(?:[134]x|[0134]:)\s*\d{4,5}", re.IGNORECASE)
"""Notation 4x0001 or 4:0001; 0x0001 is hexadecimal instead."""

_BIT = re.compile(r"(.+?)\s*(?:[.:/]\s*(?:bit\s*)?|\s+bit\s*)(\d{1,2})", re.IGNORECASE)
_RANGE = re.compile(r"(\S+?)\s*[-–]\s*\S+")
_LETTERS = re.compile(r"[a-f]", re.IGNORECASE)
_BARE_HEX = re.compile(r"[0-9a-f]{1,4}", re.IGNORECASE)


class CountedRegister(NamedTuple):
    """Register as printed in a list. kind: None if the number does not show the kind. number: as in a telegram."""

    kind: str | None
    number: int
    bit: str = ""


class RegisterNumbering(NamedTuple):
    """Numbering of a list. base: first number. hex: whether bare digits are hexadecimal. certain: not just assumed."""

    base: Base
    hex: bool
    certain: bool

    def of(self, text: str) -> CountedRegister | None:
        """Return the register that a cell names, None if it names no register."""
        text = _RANGE.sub(r"\1", text.strip())
        marked, bit = bool(_MARKED.fullmatch(text)), ""
        if not marked and (found := _BIT.fullmatch(text)) and (_number(found[1], hexadecimal=self.hex) is not None):
            text, bit = found[1], str(int(found[2]))
            if int(bit) > 15:
                return None
        if (marked or self.base == "modicon") and (modicon := _MODICON.fullmatch(text)):
            return CountedRegister(_KINDS[modicon[1][0]], int(modicon[2]) - 1, bit)
        number = _number(text, hexadecimal=self.hex)
        if number is None or self.base == "modicon":
            # In a list with Modicon numbers, the base of any other number is unknown.
            return None
        return CountedRegister(None, number - (self.base == "1" and not _HEX.fullmatch(text)), bit)


def counting_of(cells: Iterable[str], heading: str, base: Base | None) -> RegisterNumbering:
    """Return the numbering of a list, by its addresses and their heading. base: given by the user, or None."""
    given = [_RANGE.sub(r"\1", cell.strip()) for cell in cells if cell.strip()]
    bare = [cell for cell in given if _BARE_HEX.fullmatch(cell)]
    hexadecimal = bool(re.search(r"hex", heading, re.IGNORECASE)) or any(_LETTERS.search(cell) for cell in bare)
    if base is not None:
        return RegisterNumbering(base, hexadecimal, certain=True)
    if hexadecimal or any(_HEX.fullmatch(cell) for cell in given):
        return RegisterNumbering("0", hexadecimal, certain=False)
    if given and all(_MARKED.fullmatch(cell) for cell in given):
        return RegisterNumbering("modicon", hex=False, certain=True)
    numbers = [cell for cell in given if _number(cell, hexadecimal=False) is not None]
    firsts = {found[1][0] for cell in numbers if (found := _MODICON.fullmatch(cell)) and int(found[2]) > 0}
    all_alike = len(numbers) == len(given) and all(_looks_like_modicon(cell) for cell in numbers)
    if all_alike and firsts & {"3", "4"}:
        return RegisterNumbering("modicon", hex=False, certain=False)
    starts_at_0 = any(int(cell) == 0 for cell in numbers if cell.isdecimal())
    said = re.search(r"\b([01])[- ]?based|basis\s*([01])|base\s*([01])", heading, re.IGNORECASE)
    if said:
        return RegisterNumbering(cast("Base", said[1] or said[2] or said[3]), hex=False, certain=True)
    return RegisterNumbering("0", hex=False, certain=starts_at_0)


def _looks_like_modicon(cell: str) -> bool:
    found = _MODICON.fullmatch(cell)
    return found is not None and int(found[2]) > 0


def _number(text: str, *, hexadecimal: bool) -> int | None:
    text = text.strip()
    if found := _HEX.fullmatch(text):
        return int(found[1] or found[2], 16)
    if hexadecimal and _BARE_HEX.fullmatch(text):
        return int(text, 16)
    return int(text) if _DECIMAL.fullmatch(text) and text.isascii() else None
