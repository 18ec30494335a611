"""Differences between Modbus drives that are independent of a model's parameters."""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal
from typing import Literal, TypeAlias

from drivecomm.errors import UsageError
from drivecomm.protocol import exact
from drivecomm_modbus.functions import MOST_REGISTERS_READ

Hertz: TypeAlias = Decimal | int | float | str


@dataclass(frozen=True, slots=True, kw_only=True)
class ModbusOptions:
    """Options of a Modbus drive; the model of a series sets them.

    framing: framing of the telegrams: "rtu", "ascii" (with 7 data bits and even parity by the standard, which a bus
    does not choose by itself), or "tcp" for a drive on Ethernet or a gateway, whose unit number is the address.

    register_base: number in the manual for the register with address 0 in a telegram: 0 if it prints telegram addresses
    (Delta 2000H), 1 (Danfoss 50000 is C34FH), 40001 (ABB, Siemens V20). coil_base: the same for coils. word_order: the
    half of a 32-bit value that has the lower register, "high" or "low". write_function: the function that is tried
    first: 16, with 15 for coils, or 6, with 5. The reply to 5 and 6 equals the request byte for byte, so the echo of a
    two-wire adapter can be mistaken for it. wide_functions: whether 32 bits are read and written by functions 64H and
    65H (Bonfiglioli) instead of two registers. max_registers: largest number of registers read by one telegram, 1 for
    one parameter at a time. bridged_registers: largest number of unneeded registers between two that are read in one
    telegram; only for drives that answer for registers which they do not have. highest_address: 247 by the standard; a
    model may allow up to 255 (Delta 254).

    reference_maximum_hz: the frequency of a reference of 100 % (Danfoss 3-03, ABB 1105), for drives that accept their
    reference in only one form and report no range for the other; it overrides the range that the drive reports, and is
    the highest reference in either form. reference_minimum_hz: the frequency of 0 % if it is not 0 Hz (Danfoss 3-02),
    for drives that accept per cent only.

    state_timeout_s: seconds in which a drive must obey a start; otherwise the start is withdrawn. reply_delay_s: reply
    delay of a virtual drive, in seconds.
    """

    framing: Literal["rtu", "ascii", "tcp"] = "rtu"
    register_base: int = 0
    coil_base: int = 0
    word_order: Literal["high", "low"] = "high"
    write_function: Literal[6, 16] = 16
    wide_functions: bool = False
    max_registers: int = 16
    bridged_registers: int = 0
    highest_address: int = 247
    reference_minimum_hz: Hertz = 0
    reference_maximum_hz: Hertz | None = None
    state_timeout_s: float = 3.0
    reply_delay_s: float = 0.005

    def __post_init__(self) -> None:
        for name, most in {"max_registers": MOST_REGISTERS_READ, "highest_address": 255}.items():
            if not 1 <= getattr(self, name) <= most:
                raise UsageError(f"{name} of {getattr(self, name)} is not 1 to {most}")
        for name in ("register_base", "coil_base", "bridged_registers", "state_timeout_s", "reply_delay_s"):
            if getattr(self, name) < 0:
                raise UsageError(f"{name} of {getattr(self, name)} is negative")
        lowest, highest = self.reference_range
        if lowest < 0 or (highest is not None and highest <= lowest):
            raise UsageError(
                f"reference_minimum_hz of {lowest} is not from 0 to below reference_maximum_hz of {highest}"
            )

    @property
    def addresses(self) -> range:
        """Valid addresses of a drive."""
        return range(1, self.highest_address + 1)

    @property
    def reference_range(self) -> tuple[Decimal, Decimal | None]:
        """The frequencies of a reference of 0 % and 100 %; the latter is None if not given."""
        lowest, highest = exact(self.reference_minimum_hz, "reference_minimum_hz"), self.reference_maximum_hz
        return lowest, None if highest is None else exact(highest, "reference_maximum_hz")
