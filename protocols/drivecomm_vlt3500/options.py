"""Differences between VLT drives, and unknown facts about them, which are configurable for that reason."""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal, localcontext
from typing import TYPE_CHECKING, Literal

from drivecomm.errors import UsageError, ValueRefusedError
from drivecomm.protocol import exact, reference_limit_of
from drivecomm_vlt3500 import words

if TYPE_CHECKING:
    from drivecomm.protocol import Value


@dataclass(frozen=True, slots=True, kw_only=True)
class VltOptions:
    """Options of a VLT 2000, 3000 or 3500.

    idle_word: the control word that commands nothing, bit 10 = 0. With 0x000F a reply can never equal the request,
    because ready and tripped exclude each other. With 0x0000 (as in the manuals) the answer of a drive in local
    operation can equal the request byte for byte, and then counts as an echo. lenient_status: use the low four bits of
    any character in a status word, not only of `@` to `O`. dc_brake: control bit 4 is DC braking (VLT 2000 with
    parameter 514 = 1, from a public program). setups: number of set-ups of the drive, 4 or (VLT 2000) 2.

    maximum_hz: the drive's maximum frequency, which `set_reference(hz=)` needs. minimum_hz: its minimum frequency.
    reference_span: meaning of 100 % in parameter 516: "maximum" for the maximum frequency, "span" for maximum minus
    minimum, counted from the minimum; the manuals define it for a minimum of 0 only, where both are the same.
    reference_limit: the largest percentage that `set_reference` sends; the drive's own range is unknown.
    fault_parameter: the parameter that `status` reads of a tripped drive to name the fault, such as "502[18]" (alarm
    word of a VLT 2000); empty for none, because alarm numbers are unknown. state_timeout_s: seconds in which a
    commanded state must be reached.

    For a virtual drive: reply_delay_s: reply delay in seconds. copies_unchecked: whether a request with `??` for a
    checksum is answered with `??`, otherwise with a checksum. start_inhibit: parameter 309 is set to 11, "start not
    possible". reference_decimals: decimals of parameter 516. answers_broken: broken telegrams are answered with cause
    99 instead of silence (the manuals do not describe the behaviour of a drive).
    """

    idle_word: int = words.IDLE
    lenient_status: bool = False
    dc_brake: bool = False
    setups: Literal[2, 4] = 4
    maximum_hz: Value | float | None = None
    minimum_hz: Value | float = 0
    reference_span: Literal["maximum", "span"] = "maximum"
    reference_limit: Value | float = 100
    fault_parameter: str = ""
    state_timeout_s: float = 2.0
    reply_delay_s: float = 0.010
    copies_unchecked: bool = True
    start_inhibit: bool = False
    reference_decimals: Literal[0, 1, 2, 3, 4, 5] = 2
    answers_broken: bool = False

    def __post_init__(self) -> None:
        if type(self.idle_word) is not int or self.idle_word not in range(0x10000) or self.idle_word & words.VALID:
            raise UsageError("an idle word has 16 bits, and bit 10 of them is 0, or the drive would obey it")
        reference_limit_of(self.reference_limit)
        if self.maximum_hz is not None and not 0 <= self.frequency("minimum_hz") < self.frequency("maximum_hz"):
            raise UsageError("minimum_hz is at least 0 and below maximum_hz")

    def frequency(self, name: str) -> Decimal:
        """Return maximum_hz, minimum_hz or reference_limit as an exact number."""
        return exact(getattr(self, name), name)

    def percent_of(self, hz: Decimal) -> Decimal:
        """Return the exact percentage of the bus reference for a frequency. Raises ValueRefusedError."""
        highest, lowest = self.frequency("maximum_hz"), self.frequency("minimum_hz")
        if self.reference_span == "maximum":
            lowest = Decimal(0)
        if abs(hz) < lowest:
            raise ValueRefusedError(f"{hz} Hz is below the minimum frequency of {lowest} Hz")
        span = highest - lowest
        with localcontext() as context:
            context.prec = 60
            above = (abs(hz) - lowest) * 100
            percent = (above / span).normalize()
            if percent * span != above:
                raise ValueRefusedError(f"{hz} Hz of {highest} Hz is not an exact percentage, and it is not rounded")
        return percent.copy_sign(hz)
