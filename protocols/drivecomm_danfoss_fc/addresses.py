"""Which parameters a drive may hold: numbers of PNU from 1, each with up to 255 further array elements.

PNU of 11 bits: VLT 6000 manual p. 124, and from 1 to 990: VLT 5000 PROFIBUS manual p. 24. PNU of 12 bits, so that 4095
is the highest: FC 101 Design Guide MG18C822, 7.4.8. The index is the low byte of IND: the same, 7.4.9, and VLT 5000
Crane manual p. 98. Faults 0, 3 and 4 are in the tables of all manuals.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.protocol import AddressSpace, Elements
from drivecomm_danfoss_fc.faultcodes import NO_SUCH_INDEX, NO_SUCH_PARAMETER, NOT_AN_ARRAY

if TYPE_CHECKING:
    from drivecomm.protocol import Model
    from drivecomm_danfoss_fc.options import DanfossFcOptions

_OLD_BITS, _OLD_NUMBERS = 11, range(1, 991)

_HIGHEST_INDEX = 255
"""No array of the manuals is as long; a drive that answers it does not look at the index."""


def address_space(options: DanfossFcOptions, model: Model | None) -> AddressSpace:
    """Return what addresses a drive can hold. options: how many bits its PNU has. model: how its addresses look."""
    grouped = model is None or any("-" in address for address in model.parameters)
    numbers = range(1, 2**options.pnu_bits) if options.pnu_bits > _OLD_BITS else _OLD_NUMBERS
    return AddressSpace(
        addresses=lambda: (_written(number, grouped=grouped) for number in numbers),
        absent=frozenset({NO_SUCH_PARAMETER, NO_SUCH_INDEX, NOT_AN_ARRAY}),
        source=(
            "PNU of 11 bits, 1 to 990: VLT 6000 manual p. 124, VLT 5000 PROFIBUS manual p. 24; of 12 bits: FC 101 "
            "Design Guide MG18C822, 7.4.8"
        ),
        elements=_indices,
    )


def _written(number: int, *, grouped: bool) -> str:
    return f"{number // 100}-{number % 100:02d}" if grouped else f"{number:03d}"


def _indices(address: str, code: int | None) -> Elements:
    # An array that counts from 1 has no element 0, which is what the plain address asks for.
    if code not in (None, NO_SUCH_INDEX):
        return Elements()
    run = tuple(f"{address}[{index}]" for index in range(1, _HIGHEST_INDEX))
    return Elements(runs=(run,), beyond=f"{address}[{_HIGHEST_INDEX}]")
