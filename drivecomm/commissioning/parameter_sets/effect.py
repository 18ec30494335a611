"""What the values of a parameter set mean to its drive: which of them count, and what its watchdog is set to.

A number alone does not say it: a time whose function is off does nothing. What depends on what is in the models.
"""

from __future__ import annotations

from decimal import Decimal
from typing import TYPE_CHECKING, cast

from drivecomm.bus import carry_out, reading_steps
from drivecomm.commissioning.parameter_sets.values import in_unit
from drivecomm.errors import UsageError
from drivecomm.models import load_model, parameter_at
from drivecomm.protocol import Reading, installed

if TYPE_CHECKING:
    from collections.abc import Mapping
    from typing import Any

    from drivecomm.bus import Drive, Setting
    from drivecomm.commissioning.parameter_sets.parameter_set import Entry, ParameterSet
    from drivecomm.protocol import Model, ParameterInfo, Value


def model_of(known: ParameterSet) -> Model | None:
    """Return the model that a set was read with, None where no model is found by its name."""
    try:
        return load_model(installed[known.protocol].package, known.protocol, known.model)
    except UsageError:
        return None


class Held:
    """Values by address that answer steps as a drive would that holds them; what is written changes them."""

    def __init__(self, name: str, values: Mapping[str, Value]) -> None:
        self._name = name
        self.values = dict(values)

    def read(self, parameter: str) -> Reading:
        """Return a value. Raises UsageError for one that is not held."""
        if parameter not in self.values:
            raise UsageError(f"the parameter set of {self._name} does not hold {parameter}")
        return Reading(parameter=parameter, value=self.values[parameter], raw=str(self.values[parameter]))

    def write(self, parameter: str, value: Value, **_: Any) -> None:
        """Take a value."""
        self.values[parameter] = value

    def watched(self, silence_s: float | None) -> None:
        """Do nothing: nobody waits for commands."""

    @property
    def as_drive(self) -> Drive:
        """This, for those who carry out steps with a drive."""
        return cast("Drive", self)


def watchdog_told(known: ParameterSet, model: Model) -> Setting:
    """Return what the watchdog of the set's drive was set to. Raises UsageError where the set does not tell it."""
    held = Held(known.drive, {entry.address: _in_units_of(model, entry) for entry in known.entries.values()})
    return carry_out(held.as_drive, reading_steps(known.drive, model))


def is_watchdog_time(address: str, model: Model) -> bool:
    """Whether a parameter is the time of the drive's watchdog, which means nothing without what the watchdog does."""
    info = parameter_at(address, model)
    return info is not None and model.watchdog is not None and info.address == model.watchdog.time


def without_effect(entry: Entry, known: ParameterSet, model: Model) -> str:
    """Return why a value counts for nothing on the set's drive, or that nobody knows; empty where it counts."""
    info = parameter_at(entry.address, model)
    element = entry.address[len(entry.parameter) :]
    for address in info.only_with if info else ():
        other = known.entries.get(address + element) or known.entries.get(address)
        if other is None:
            return f"it counts only with some values of {address}, which the set does not hold"
        if not counts_with(model, info, address, _in_units_of(model, other)):
            return f"it is without effect, because {address} {other.name} is {other}"
    return ""


def counts_with(model: Model, info: ParameterInfo | None, address: str, value: Value) -> bool:
    """Whether a parameter counts while another one that it depends on has this value."""
    other = parameter_at(address, model)
    if info is None or other is None or isinstance(value, str):
        return False
    return Decimal(value) / other.factor in info.only_with[address]


def _in_units_of(model: Model, entry: Entry) -> Value:
    info = parameter_at(entry.address, model)
    try:
        return in_unit(entry.value, entry.unit, info.unit) if info else entry.value
    except UsageError:
        return entry.value
