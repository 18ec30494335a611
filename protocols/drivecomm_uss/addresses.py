"""Which parameters a USS drive may hold: the numbers that its index word can name, and the elements of arrays.

USS specification C-8 to C-13; the highest number is that of the series' index word, see `parameters`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.protocol import NO_ELEMENTS, AddressSpace, Elements
from drivecomm_uss.parameters import HIGHEST

if TYPE_CHECKING:
    from drivecomm.protocol import Model
    from drivecomm_uss.options import UssOptions

_NO_NUMBER, _NO_INDEX, _NO_ARRAY = 0, 3, 4
_MOST = 30_000
"""The table of pages that is printed ends with 29999."""

_ELEMENTS = range(1, 255)


def address_space(options: UssOptions, _model: Model | None) -> AddressSpace:
    """Return what addresses a drive of this series can hold."""
    return AddressSpace(
        addresses=lambda: map(str, range(min(HIGHEST[options.ind], _MOST))),
        absent=frozenset({_NO_NUMBER, _NO_INDEX, _NO_ARRAY}),
        source="USS specification C-8 to C-13: numbers and index word; C-14: error numbers 0, 3 and 4",
        elements=_elements,
    )


def _elements(address: str, code: int | None) -> Elements:
    if code not in (None, _NO_INDEX):
        return NO_ELEMENTS
    return Elements(runs=(tuple(f"{address}[{index}]" for index in _ELEMENTS),))
