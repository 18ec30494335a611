"""How drives of a series are commanded and store: the table [control] of their model, and nothing in Python."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from drivecomm.errors import UsageError
from drivecomm.profiles import ORDERS, ControlProfile, Place, profile_of_orders, status_of, steps_of
from drivecomm_modbus.functions import EXCEPTIONS
from drivecomm_modbus.parameters import place_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.profiles import Condition, Step
    from drivecomm.protocol import Model
    from drivecomm_modbus.options import ModbusOptions

_STORING = ("store_before", "store_after", "volatile_before")
_PLAIN = (
    "fault_code", "reference_hz", "reference_percent", "needs", "plain_write", "volatile_offset", "identity",
    "identification",
)  # fmt: skip
KEYS = frozenset({*ORDERS, *_STORING, *_PLAIN, "status", "start_pause_s", "exceptions", "probe"})
_FIRST_REGISTER = Place("", 0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Control:
    """The table [control] of a model; the README of the package explains each key."""

    profile: ControlProfile = field(default_factory=lambda: ControlProfile(name=""))
    storing: Mapping[str, tuple[Step, ...]] = field(default_factory=dict)
    status: Mapping[str, Condition] = field(default_factory=dict)
    fault_code: str = ""
    reference_hz: str = ""
    reference_percent: str = ""
    needs: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    plain_write: Literal["", "stored", "volatile"] = ""
    volatile_offset: int = 0
    exceptions: Mapping[int, str] = field(default_factory=lambda: EXCEPTIONS)
    probe: Place = _FIRST_REGISTER
    identity: Mapping[str, str] = field(default_factory=dict)
    identification: int | None = None

    @property
    def can_store(self) -> bool:
        """Whether a write can be kept in EEPROM."""
        return self.plain_write == "stored" or not self.storing.keys().isdisjoint(("store_before", "store_after"))

    @property
    def can_keep_volatile(self) -> bool:
        """Whether a write can be kept out of EEPROM."""
        return self.plain_write == "volatile" or "volatile_before" in self.storing or self.volatile_offset > 0


def control_of(model: Model | None, options: ModbusOptions) -> Control:
    """Return how drives of a model are commanded; not at all without one. Raises UsageError for a wrong table."""
    if model is None:
        return Control()
    given = model.control

    def place(address: str) -> tuple[str, int]:
        found = place_of(address, options)
        return found.name, found.bits[1]

    steps = {name: steps_of(name, given[name], place) for name in (*ORDERS, *_STORING) if name in given}
    status = status_of(given.get("status", {}), place)
    for key in ("fault_code", "reference_hz", "reference_percent"):
        if key in given and model.find(given[key]) is None:
            raise UsageError(f"[control] {key}: {given[key]!r} is no parameter of the model")
    first = Place.named(next(iter(status.values())).place) if status else _FIRST_REGISTER
    return Control(
        profile=profile_of_orders(model.name, steps, status, given.get("start_pause_s", 0.0)),
        storing={name: steps[name] for name in _STORING if name in steps},
        status=status,
        probe=place_of(given["probe"], options) if "probe" in given else first,
        exceptions={**EXCEPTIONS, **{int(code): text for code, text in given.get("exceptions", {}).items()}},
        **{key: given[key] for key in _PLAIN if key in given},
    )
