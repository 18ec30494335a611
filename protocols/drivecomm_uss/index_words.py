"""IND: array index, and what the makers put beside it (USS specification C-18 to C-21).

page          index in bits 0-7, page of 2000 parameters in bits 15-10 with the weights 1 8 4 2 32 16
              (CU240S Operating Instructions 11/2006 p. 8-31; MICROMASTER 420 Operating Instructions p. 115)
masterdrives  index in bits 0-7, page in bit 15; with AK 15 bit 8 writes a text and bit 9 means the second text field
              (Compendium Motion Control p. 8.1-14)
nord          parameter set 1 to 4 in bits 0-1, array element in bits 2-7 (BU 0050 p. 41)
plain         index in bits 0-7
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from drivecomm_uss.messages import Reply, Request
    from drivecomm_uss.options import Ind

_WEIGHTS = {15: 1, 14: 8, 13: 4, 12: 2, 11: 32, 10: 16}
"""What each bit of the page counts; not in the order of the bits."""

_TEXT = 15
_ABSENT = None

IndParts = tuple[int, int | None, int | None, int | None, bool | None]
"""index, page, parameter_set, text_field, text_write"""


def parts_of(word: int, ak: int, layout: Ind) -> IndParts:
    """Return what an index word says. Raises ValueError for bits that mean nothing here."""
    index = word & 0xFF
    if layout == "nord":
        _no_more(word, 0xFF)
        return word >> 2 & 0x3F, _ABSENT, (word & 3) + 1, _ABSENT, _ABSENT
    if layout == "plain":
        _no_more(word, 0xFF)
        return index, _ABSENT, _ABSENT, _ABSENT, _ABSENT
    if layout == "page":
        _no_more(word, 0xFCFF)
        return index, sum(weight for bit, weight in _WEIGHTS.items() if word >> bit & 1), _ABSENT, _ABSENT, _ABSENT
    if ak != _TEXT:
        _no_more(word, 0x80FF)
        return index, word >> 15, _ABSENT, _ABSENT, _ABSENT
    _no_more(word, 0x83FF)
    return index, word >> 15, _ABSENT, (word >> 9 & 1) + 1, bool(word >> 8 & 1)


def word_of(message: Request | Reply, layout: Ind) -> int:
    """Return the index word of a message. Raises ValueError for what does not fit."""
    index = _in("index", message.index or 0, range(64 if layout == "nord" else 256))
    own = {"nord": ("parameter_set",), "page": ("page",), "masterdrives": ("page", "text_field", "text_write")}
    for name in ("page", "parameter_set", "text_field", "text_write"):
        if getattr(message, name) is not None and name not in own.get(layout, ()):
            raise ValueError(f"{name} is not in the index word of this drive, which is read as {layout!r}")
    if layout == "nord":
        number = 1 if message.parameter_set is None else message.parameter_set
        return index << 2 | _in("parameter_set", number, range(1, 5)) - 1
    page = _in("page", message.page or 0, range(2 if layout == "masterdrives" else 64))
    if layout != "masterdrives":
        return index | sum(1 << bit for bit, weight in _WEIGHTS.items() if page & weight)
    word = index | page << 15
    if message.ak == _TEXT:
        field = 1 if message.text_field is None else message.text_field
        return word | _in("text_field", field, range(1, 3)) - 1 << 9 | bool(message.text_write) << 8
    if message.text_field is not None or message.text_write is not None:
        raise ValueError("text_field and text_write belong to AK 15")
    return word


def _no_more(word: int, used: int) -> None:
    if word & ~used:
        raise ValueError(f"index word {word:04X} has bits that mean nothing here")


def _in(name: str, value: object, allowed: range) -> int:
    if type(value) is not int or value not in allowed:
        raise ValueError(f"{name} {value!r} is not {allowed.start} to {allowed.stop - 1}")
    return value
