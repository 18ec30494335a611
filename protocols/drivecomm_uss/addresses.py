"""Which parameters a USS drive may hold: the numbers that its index word can name, and the elements of arrays."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.protocol import NO_ELEMENTS, AddressSpace, Elements
from drivecomm_uss.parameter_area import numbers_of
from drivecomm_uss.tasks import NO_ARRAY, NO_INDEX, NO_NUMBER

if TYPE_CHECKING:
    from drivecomm.protocol import Model
    from drivecomm_uss.options import UssOptions

_MOST = 30_000
"""The table of pages that is printed ends with 29999."""


def address_space(options: UssOptions, _model: Model | None) -> AddressSpace:
    """Return what addresses a drive of this series can hold."""
    return AddressSpace(
        addresses=lambda: map(str, numbers_of(options.ind)[:_MOST]),
        absent=frozenset({NO_NUMBER, NO_INDEX, NO_ARRAY}),
        source="USS specification C-8 to C-13: numbers and index word; C-14: error numbers 0, 3 and 4",
        elements=_elements,
    )


def _elements(address: str, code: int | None) -> Elements:
    if code not in (None, NO_INDEX):
        return NO_ELEMENTS
    return Elements(runs=(tuple(f"{address}[{index}]" for index in range(1, 255)),))
