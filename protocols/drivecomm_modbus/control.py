"""Commands and storage of the drives of a series, defined only by the table [control] of their model."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from drivecomm.profiles import CONTROL_KEYS, ControlTable, RegisterPlace, control_entries
from drivecomm.protocol import cached
from drivecomm_modbus.functions import EXCEPTIONS
from drivecomm_modbus.parameters import place_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.protocol import Model
    from drivecomm_modbus.options import ModbusOptions

_PLAIN = ("identity", "identification", "functions", "diagnostics", "refusals")
KEYS = CONTROL_KEYS | {*_PLAIN, "exceptions", "probe", "broadcasts"}


@dataclass(frozen=True, slots=True, kw_only=True)
class ModbusControl(ControlTable):
    """The table [control] of a model; the README of the package explains each key."""

    exceptions: Mapping[int, str] = field(default_factory=lambda: EXCEPTIONS)
    probe: RegisterPlace = field(default=RegisterPlace("", 0))
    identity: Mapping[str, str] = field(default_factory=dict)
    identification: int | None = None
    functions: tuple[int, ...] = ()
    diagnostics: tuple[int, ...] = (0,)
    broadcasts: frozenset[str] = frozenset()
    refusals: Mapping[str, int] = field(default_factory=dict)


@cached
def control_of(model: Model | None, options: ModbusOptions) -> ModbusControl:
    """Return the commands of drives of a model; empty without a model. Raises UsageError for an invalid table."""
    if model is None:
        return ModbusControl()
    given, entries = model.control, control_entries(model, lambda address: place_of(address, options))
    looked_at = next((condition.place for condition in entries["status"].values()), "0")
    return ModbusControl(
        **entries,
        probe=place_of(given["probe"], options) if "probe" in given else RegisterPlace.named(looked_at),
        broadcasts=frozenset(place_of(each, options).name for each in given.get("broadcasts", ())),
        exceptions={**EXCEPTIONS, **{int(code): text for code, text in given.get("exceptions", {}).items()}},
        **{key: given[key] for key in _PLAIN if key in given},
    )
