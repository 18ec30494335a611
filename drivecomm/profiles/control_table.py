"""The table [control] of a model: how drives whose commands are registers are commanded, and how they store a write.

Beside the commands and the status of `drivecomm.profiles.order_tables` it says which parameters are the references and
the code of a fault, what a start needs, and where a write goes.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

from drivecomm.errors import UsageError
from drivecomm.profiles.order_tables import ORDERS, profile_of_orders, status_of, steps_of
from drivecomm.profiles.profile import ControlProfile

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from drivecomm.profiles.profile import Condition, Step
    from drivecomm.profiles.registers import Place
    from drivecomm.protocol import Model

_STORING = ("store_before", "store_after", "volatile_before")
_PARAMETERS = ("fault_code", "reference_hz", "reference_percent")
_PLAIN = (*_PARAMETERS, "needs", "plain_write", "volatile_offset")
CONTROL_KEYS = frozenset({*ORDERS, *_STORING, *_PLAIN, "status", "start_pause_s"})


@dataclass(frozen=True, slots=True, kw_only=True)
class ControlTable:
    """What a table [control] says.

    storing: the steps before and after a write that goes to EEPROM, and those that keep one out of it. status: the
    conditions of the status, by name. fault_code, reference_hz, reference_percent: addresses of parameters, empty where
    there are none. needs: the raw values with which a drive obeys, by address. plain_write: where a write goes without
    such steps, empty where that is not known. volatile_offset: how much higher the registers are that keep it in RAM.
    """

    profile: ControlProfile = field(default_factory=lambda: ControlProfile(name=""))
    storing: Mapping[str, tuple[Step, ...]] = field(default_factory=dict)
    status: Mapping[str, Condition] = field(default_factory=dict)
    fault_code: str = ""
    reference_hz: str = ""
    reference_percent: str = ""
    needs: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    plain_write: Literal["", "stored", "volatile"] = ""
    volatile_offset: int = 0

    @property
    def can_store(self) -> bool:
        """Whether a write can be kept in EEPROM."""
        return self.plain_write == "stored" or not self.storing.keys().isdisjoint(("store_before", "store_after"))

    @property
    def can_keep_volatile(self) -> bool:
        """Whether a write can be kept out of EEPROM."""
        return self.plain_write == "volatile" or "volatile_before" in self.storing or self.volatile_offset > 0


def control_entries(model: Model, place_of: Callable[[str], Place]) -> dict[str, Any]:
    """Return what the table of a model says, as arguments of `ControlTable`. Raises UsageError for a wrong table.

    place_of: where the register, the coil or the part of a register with an address is.
    """

    def spot_of(address: str) -> tuple[str, int]:
        place = place_of(address)
        return place.name, place.bits[1]

    given = model.control
    steps = {name: steps_of(name, given[name], spot_of) for name in (*ORDERS, *_STORING) if name in given}
    status = status_of(given.get("status", {}), spot_of)
    for key in _PARAMETERS:
        if key in given and model.find(given[key]) is None:
            raise UsageError(f"[control] {key}: {given[key]!r} is no parameter of the model")
    return {
        "profile": profile_of_orders(model.name, steps, status, given.get("start_pause_s", 0.0)),
        "storing": {name: steps[name] for name in _STORING if name in steps},
        "status": status,
        **{key: given[key] for key in _PLAIN if key in given},
    }
