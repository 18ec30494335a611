"""Which parameters a VLT may hold: numbers of three digits, some of them with one index or two.

The telegram has room for four digits (VLT Series 3500 manual, printed page 87); every number that the manuals print has
three. What a drive answers to R on an indexed parameter is printed nowhere; cause 02, "no such index", is what the
table of printed page 92 has for it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.protocol import AddressSpace, Elements
from drivecomm_vlt3500.causes import NO_SUCH_INDEX, NOT_INDEXED, UNKNOWN_PARAMETER

if TYPE_CHECKING:
    from drivecomm.protocol import Model
    from drivecomm_vlt3500.options import VltOptions

_NUMBERS = range(1000)
_ELEMENTS = range(100)
"""y has two digits; no index that is printed has more."""

_ROWS = range(20)
"""The fault memory has some ten; a run that has no first element costs one question."""


def address_space(_options: VltOptions, _model: Model | None) -> AddressSpace:
    """Return what addresses a drive can hold; no option and no model narrows them."""
    return AddressSpace(
        addresses=lambda: (f"{number:03d}" for number in _NUMBERS),
        absent=frozenset({UNKNOWN_PARAMETER, NO_SUCH_INDEX, NOT_INDEXED}),
        source="numbers of three digits: VLT Series 3500 manual, printed pages 87 to 92; causes: printed page 92",
        elements=_indices,
    )


def _indices(address: str, code: int | None) -> Elements:
    if code != NO_SUCH_INDEX:
        return Elements()
    # Whether an index begins at 0 or 1 is not printed.
    flat = tuple(tuple(f"{address}[{x}]" for x in _ELEMENTS[first:]) for first in (0, 1))
    pairs = tuple(tuple(f"{address}[{x},{y}]" for y in _ELEMENTS) for x in _ROWS)
    return Elements(runs=flat + pairs)
