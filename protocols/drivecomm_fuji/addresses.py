"""Which functions a Fuji inverter may have: the type letters of its generation, each with its numbers.

The letters and the highest number of each generation are in `profiles`, with their pages: the page 9-15 of the
VXSM150-1 manual, FRENIC5000 G11S RS-485 manual p. 9, FRENIC-VG option manual 5-20, HVAC/AQUA RS-485 manual 3-5 and 4-4.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.protocol import AddressSpace
from drivecomm_fuji.errorcodes import FUNCTION_ERROR

if TYPE_CHECKING:
    from drivecomm.protocol import Model
    from drivecomm_fuji.options import FujiOptions

_TWO_DIGITS = 99


def address_space(options: FujiOptions, _model: Model | None) -> AddressSpace:
    """Return what functions an inverter can have. options: its generation, and whether higher numbers are let pass."""
    profile = options.generation
    highest = profile.highest_number if options.number_check else _TWO_DIGITS
    return AddressSpace(
        addresses=lambda: (f"{letter}{number:02d}" for letter in profile.types for number in range(highest + 1)),
        absent=frozenset({FUNCTION_ERROR}),
        source=(
            "type letters and highest numbers: VXSM150-1 manual 9-15, FRENIC5000 G11S RS-485 manual p. 9, FRENIC-VG "
            "option manual 5-20, HVAC/AQUA RS-485 manual 3-5, 4-4; error 78: HVAC/AQUA RS-485 manual 4-17"
        ),
    )
