"""What differs between Modbus drives before a model says anything of their parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from drivecomm.errors import UsageError
from drivecomm_modbus.functions import MOST_REGISTERS_READ


@dataclass(frozen=True, slots=True, kw_only=True)
class ModbusOptions:
    """Options of a Modbus drive; the model of a series sets them.

    register_base: what the manual calls the register that has address 0 in a telegram: 0 where it prints telegram
    addresses (Delta 2000H), 1 (Danfoss 50000 is C34FH), 40001 (ABB, Siemens V20). coil_base: the same for coils.
    word_order: which half of a 32-bit value has the lower register, "high" or "low". write_function: which is tried
    first, 16, with 15 for coils, or 6, with 5; the reply to 5 and 6 is the request byte for byte, so that the echo of a
    two-wire adapter passes for it. wide_functions: 32 bits are read and written by functions 64H and 65H (Bonfiglioli)
    instead of two registers. max_registers: how many one telegram reads at most, 1 for one parameter at a time.
    bridged_registers: how many that nobody asked for may lie between two that are read together; only for drives that
    answer for registers which they do not have. highest_address: 247 by the standard; a model that says so may allow up
    to 255 (Delta 254). state_timeout_s: how long a drive has to obey a start, which is taken back
    otherwise. reply_delay_s: how soon a virtual drive answers.
    """

    register_base: int = 0
    coil_base: int = 0
    word_order: Literal["high", "low"] = "high"
    write_function: Literal[6, 16] = 16
    wide_functions: bool = False
    max_registers: int = 16
    bridged_registers: int = 0
    highest_address: int = 247
    state_timeout_s: float = 3.0
    reply_delay_s: float = 0.005

    def __post_init__(self) -> None:
        for name, most in {"max_registers": MOST_REGISTERS_READ, "highest_address": 255}.items():
            if not 1 <= getattr(self, name) <= most:
                raise UsageError(f"{name} of {getattr(self, name)} is not 1 to {most}")
        for name in ("register_base", "coil_base", "bridged_registers", "state_timeout_s", "reply_delay_s"):
            if getattr(self, name) < 0:
                raise UsageError(f"{name} of {getattr(self, name)} is negative")

    @property
    def addresses(self) -> range:
        """The addresses that a drive can have."""
        return range(1, self.highest_address + 1)
