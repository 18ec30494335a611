"""The references of a Fuji inverter: S05 in hertz, S01 as a share of the maximum frequency, M05 and M01 for what holds.

S01 beats S05 as soon as it is not zero (FVR-E11S manual 9-20), reading either returns what was sent and not what is
effective, and any master may have set the other one. So it is set to zero each time, and what holds is read back.
"""

from __future__ import annotations

from decimal import Decimal
from typing import TYPE_CHECKING

from drivecomm.errors import RefusedError, StateError, ValueRefusedError
from drivecomm_fuji import words
from drivecomm_fuji.telegrams import BROADCAST
from drivecomm_fuji.words import FREQUENCY, FREQUENCY_PU

if TYPE_CHECKING:
    from drivecomm.protocol import Exchange
    from drivecomm_fuji.asking import Asking
    from drivecomm_fuji.options import FujiOptions

_NEAR_PU = 10
"""How far S01 and what is shown of it may lie apart, in steps of 0.005 %: 0.01 Hz of 20 Hz."""


class References:
    """The references of one inverter, or of all at station 99, who show none."""

    def __init__(self, address: int, options: FujiOptions, asking: Asking) -> None:
        self._asking = asking
        self._profile = options.generation
        self._reads_back = options.reference_read_back and address != BROADCAST

    def set_frequency(self, data: int) -> Exchange[None]:
        """Write S05, in 0.01 Hz. Raises StateError when another reference holds then."""
        yield from self._asking.write(FREQUENCY_PU, 0)
        yield from self._asking.write(FREQUENCY, data)
        yield from self._confirm_reference(words.FINAL, data, 1)

    def set_per_unit(self, data: int) -> Exchange[None]:
        """Write S01, signed, in 20000ths of the maximum. Raises StateError when another reference holds then."""
        if self._profile.s05_is_frequency:
            yield from self._asking.write(FREQUENCY, 0)
        yield from self._asking.write(FREQUENCY_PU, data % 0x10000)
        # What an inverter keeps in hundredths of a hertz, it shows as so many steps of its maximum frequency.
        yield from self._confirm_reference(words.FINAL_PU, abs(data), _NEAR_PU)

    def _confirm_reference(self, function: str, meant: int, near: int) -> Exchange[None]:
        """Read back what the inverter makes of its references. Raises StateError when it is something else."""
        if not self._reads_back:
            return
        remedy = "if it shows no reference in standstill, use the option reference_read_back=False"
        try:
            reply = yield from self._asking.ask_for(function)
        except RefusedError as error:
            raise StateError(f"the inverter took the reference and does not show it: {error}; {remedy}") from None
        shown = 0x10000 - reply.data if reply.data >= 0x8000 and function == words.FINAL_PU else reply.data
        if abs(shown - meant) > near:
            scale, unit = (Decimal("0.01"), "Hz") if function == words.FINAL else (Decimal("0.005"), "%")
            raise StateError(
                f"the inverter took a reference of {meant * scale} {unit}, and its final reference ({function}) is "
                f"{shown * scale} {unit}: it is limited (F03, F15), or comes from elsewhere (H30, F01); {remedy}"
            )


def share(hz: Decimal, maximum: Decimal) -> int:
    """Return a frequency as S01. Raises ValueRefusedError when it is no whole step."""
    if not -maximum <= hz <= maximum:
        raise ValueRefusedError(f"{hz} Hz is outside -{maximum} to {maximum} Hz, the maximum frequency")
    steps = int(hz * words.FULL_SCALE / maximum)
    if steps * maximum / words.FULL_SCALE != hz:
        raise ValueRefusedError(f"{hz} Hz is no whole {words.FULL_SCALE}th of {maximum} Hz; it is not rounded")
    return steps
