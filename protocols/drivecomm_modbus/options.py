"""What differs between Modbus drives before a model says anything of their parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from drivecomm.errors import UsageError
from drivecomm_modbus.functions import WRITE_REGISTER, WRITE_REGISTERS


@dataclass(frozen=True, slots=True, kw_only=True)
class ModbusOptions:
    """Options of a Modbus drive; the model of a series sets them.

    register_base: what the manual calls the register that has address 0 in a telegram: 0 where it prints telegram
    addresses (Delta 2000H), 1 (Danfoss 50000 is C34FH), 40001 (ABB, Siemens V20). coil_base: the same for coils.
    word_order: which half of a 32-bit value has the lower register, "high" or "low". write_function: 16, with 15 for
    coils, or 6, with 5; the reply to 5 and 6 is the request byte for byte, so that the echo of a two-wire adapter
    passes for it. wide_functions: 32 bits are read and written by functions 64H and 65H (Bonfiglioli) instead of two
    registers. reply_delay_s: how soon a virtual drive answers.
    """

    register_base: int = 0
    coil_base: int = 0
    word_order: Literal["high", "low"] = "high"
    write_function: int = WRITE_REGISTERS
    wide_functions: bool = False
    reply_delay_s: float = 0.005

    def __post_init__(self) -> None:
        if self.write_function not in (WRITE_REGISTER, WRITE_REGISTERS):
            raise UsageError(f"write_function of {self.write_function} is neither 6 nor 16")
        if self.word_order not in ("high", "low"):
            raise UsageError(f"word_order {self.word_order!r} is neither 'high' nor 'low'")
        for name in ("register_base", "coil_base", "reply_delay_s"):
            if getattr(self, name) < 0:
                raise UsageError(f"{name} of {getattr(self, name)} is negative")
