"""Options for the differences between drives of the Danfoss FC protocol."""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal
from typing import Literal, TypeAlias

from drivecomm.errors import UsageError
from drivecomm.protocol import exact, reference_limit_of

Profile: TypeAlias = Literal["fc", "profidrive"]
Hertz: TypeAlias = Decimal | int | float | str


@dataclass(frozen=True, slots=True, kw_only=True)
class DanfossFcOptions:
    """Options of a drive that speaks the Danfoss FC protocol; the models set those of their series.

    address_format: "1-126" or "1-31" in telegrams that are sent; both are understood (seed 001). pnu_bits: 12, or 11
    for VLT 2800, 5000, 6000 and 8000. profile: "fc", or "profidrive" if 8-10 (512) is set to it. index_base: the index
    of an array's first element, used if an address gives none: 0, or 1 for the old numbers (V6; F3a p. 240).
    text_writes: False for drives whose guides only describe how texts are read (FC 101, FC 360).

    reference_minimum_hz, reference_maximum_hz: the reference range, 3-02 and 3-03 (204, 205), if the reference unit is
    Hz; without the maximum, `set_reference(hz=)` is not possible. reference_limit: the largest share of that range that
    `set_reference` sends, 200 % at most. actual_scaling: the meaning of 100 % in the actual value, the maximum
    "reference" (later FC guides) or the output frequency "limits" (VLT 5000 p. 93, VLT 6000 p. 165, FC 300 early
    edition p. 288). output_minimum_hz, output_maximum_hz: those limits, 4-12 and 4-14 (201, 202); without the maximum,
    a status shows no output frequency.

    control_word_parameter, reference_parameter: where the drive shows the control word and the reference that it last
    received over this port, 16-85 and 16-86; empty for drives that do not show them. A command is sent again, for
    example with another reference, only if the drive shows no other command; a start without a reference takes the one
    that the drive shows. fault_code_parameter: where a tripped drive keeps the code of its fault; if it is empty, the
    code is not read. broadcast_parameters: whether writes may go to all drives in one telegram; no manual says whether
    drives obey them. state_timeout_s: how long a reset may take to clear the trip.

    reply_delay_s, presets_added, catch_up_percent, off_bit_when_active: for a virtual drive. They are the minimum delay
    of a reply; whether a preset reference adds to the bus reference or replaces it; the step of catch up and slow down;
    the level of the PROFIdrive status bits 4 and 5 while OFF2 or OFF3 is active: 1 on VLT drives (V5 p. 93), 0 on FC
    drives (F3a p. 285).
    """

    address_format: Literal["1-126", "1-31"] = "1-126"
    pnu_bits: Literal[12, 11] = 12
    profile: Profile = "fc"
    index_base: Literal[0, 1] = 0
    text_writes: bool = True
    reference_minimum_hz: Hertz = 0
    reference_maximum_hz: Hertz | None = None
    reference_limit: Hertz = 100
    actual_scaling: Literal["reference", "limits"] = "reference"
    output_minimum_hz: Hertz = 0
    output_maximum_hz: Hertz | None = None
    control_word_parameter: str = "16-85"
    reference_parameter: str = "16-86"
    fault_code_parameter: str = ""
    broadcast_parameters: bool = False
    state_timeout_s: float = 2.0
    reply_delay_s: float = 0.0
    presets_added: bool = True
    catch_up_percent: Hertz = 1
    off_bit_when_active: Literal[0, 1] = 0

    def __post_init__(self) -> None:
        reference_limit_of(self.reference_limit)
        for name in ("reference", "output"):
            span(name, getattr(self, f"{name}_minimum_hz"), getattr(self, f"{name}_maximum_hz"))


def span(name: str, minimum: Hertz, maximum: Hertz | None) -> tuple[Decimal, Decimal] | None:
    """Return a range of frequencies; None if its end is unknown. Raises UsageError for an empty range."""
    lowest = exact(minimum, f"{name}_minimum_hz")
    if maximum is None:
        return None
    highest = exact(maximum, f"{name}_maximum_hz")
    if highest <= lowest:
        raise UsageError(f"{name}_maximum_hz {highest} is not above {name}_minimum_hz {lowest}")
    return lowest, highest
