"""Differences between VABus drives, which are configurable for that reason."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from drivecomm.errors import UsageError
from drivecomm_vabus.telegrams import ValueType  # noqa: TC001 - read at run time when options are checked


@dataclass(frozen=True, slots=True, kw_only=True)
class VabusOptions:
    """Options of a VABus drive.

    sys: system-bus node behind the drive, 0 for the drive itself. ram_datasets: the drive has data sets 5 to 9, which
    keep a write out of EEPROM (Agile VABus manual p. 30); without them every write is stored and needs `store=True`.
    trailing_eot: close every exchange with EOT; with "after writes", the EOT at the beginning of the next request
    closes a read, with False it closes every exchange. lower_case_hex: accept a-f in values.

    reference_hz_parameter: the parameter that `set_reference(hz=)` writes, fixed frequency 1.
    reference_percent_parameter: the parameter that `set_reference(percent=)` writes, fixed percent 1. Parameters 475
    and 476 of the drive decide whether it follows them, so its reference is read back. reference_shown_parameter: the
    parameter with its reference after summing; 0 for a drive that has none, or shows none in standstill, whose
    reference is then not read back.

    state_timeout_s: seconds in which a commanded state must be reached. type: for single telegrams, the type of their
    data.

    reply_delay_s, silent_on, fault_lock_s: for a virtual drive: reply delay in seconds, the error codes that it answers
    with silence instead of NAK, and the seconds after a fault during which it refuses the reset (ACT/ACU Modbus manual,
    German edition, p. 51).
    """

    sys: int = 0
    ram_datasets: bool = True
    trailing_eot: bool | Literal["after writes"] = True
    lower_case_hex: bool = False
    reference_hz_parameter: int = 480
    reference_percent_parameter: int = 520
    reference_shown_parameter: int = 283
    state_timeout_s: float = 2.0
    type: ValueType = ""
    reply_delay_s: float = 0.010
    silent_on: tuple[int, ...] = ()
    fault_lock_s: float = 15.0

    @property
    def references(self) -> frozenset[str]:
        """The parameters that are written as references; empty if every write would be stored."""
        both = (self.reference_hz_parameter, self.reference_percent_parameter)
        return frozenset(map(str, both)) if self.ram_datasets else frozenset()

    def __post_init__(self) -> None:
        if self.sys not in range(64):
            raise UsageError(f"system-bus node {self.sys} is not 0 to 63")
