"""Effect of the values of a parameter set on its drive and on another maker's: active values, and watchdog settings.

A number alone does not show its effect: a time whose function is off does nothing. The models state which parameter
depends on which.
"""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal
from typing import TYPE_CHECKING, cast

from drivecomm.bus import carry_out, read_parameter, reading_watchdog, setting_watchdog
from drivecomm.commissioning.parameter_sets.parameter_set import WRITABLE, ParameterEntry, in_unit, same
from drivecomm.errors import DriveError, ReplyError, UsageError
from drivecomm.models import load_model, parameter_at, quantities
from drivecomm.protocol import Reading, installed

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping
    from typing import Any

    from drivecomm.bus import Drive, Procedure, Setting
    from drivecomm.commissioning.parameter_sets.parameter_set import ParameterSet, Part
    from drivecomm.commissioning.parameter_sets.reading_out import SetSubject
    from drivecomm.protocol import Model, ParameterInfo, Value


def model_of(known: ParameterSet) -> Model | None:
    """Return the model with which a set was read, None if no model is found by its name."""
    try:
        return load_model(installed[known.protocol].package, known.protocol, known.model)
    except UsageError:
        return None


class StoredValues:
    """Stored values by address that can stand in for a drive when steps are carried out; writes change the values."""

    def __init__(self, name: str, values: Mapping[str, Value]) -> None:
        self._name = name
        self.values = dict(values)

    def read(self, parameter: str) -> Reading:
        """Return a stored value. Raises UsageError for an address without a value."""
        if parameter not in self.values:
            raise UsageError(f"the parameter set of {self._name} does not hold {parameter}")
        return Reading(parameter=parameter, value=self.values[parameter], raw=str(self.values[parameter]))

    def write(self, parameter: str, value: Value, **_: Any) -> None:
        """Store a value."""
        self.values[parameter] = value

    def watched(self, silence_s: float | None) -> None:
        """Do nothing, because stored values need no watchdog feed."""

    @property
    def as_drive(self) -> Drive:
        """This object, typed as a drive for functions that carry out steps."""
        return cast("Drive", self)


def watchdog_setting(known: ParameterSet, model: Model) -> Setting:
    """Return the watchdog setting of the set's drive. Raises UsageError if the set does not contain it."""
    held = StoredValues(known.drive, {entry.address: _in_units_of(model, entry) for entry in known.entries.values()})
    return carry_out(held.as_drive, reading_watchdog(known.drive, model))


def is_watchdog_time(address: str, model: Model) -> bool:
    """Return whether a parameter is the drive's watchdog time, which has no meaning without the watchdog's action."""
    info = parameter_at(address, model)
    return info is not None and model.watchdog is not None and info.address == model.watchdog.time


def without_effect(entry: ParameterEntry, known: ParameterSet, model: Model) -> str:
    """Return why a value has no effect, or an unknown effect, on the set's drive; empty if it has an effect."""
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
    """Return whether a parameter has an effect while another one, on which it depends, has this value."""
    other = parameter_at(address, model)
    if info is None or other is None or isinstance(value, str):
        return False
    return Decimal(value) / other.factor in info.only_with[address]


def _in_units_of(model: Model, entry: ParameterEntry) -> Value:
    info = parameter_at(entry.address, model)
    try:
        return in_unit(entry.value, entry.unit, info.unit) if info else entry.value
    except UsageError:
        return entry.value


def common_values(
    known: ParameterSet, parts: Collection[Part], model: Model | None
) -> tuple[dict[str, ParameterEntry], dict[str, str]]:
    """Return one entry for each common name, with the common name as its address, and why others have no entry.

    A parameter with one value for each data set gets an entry only if all its values are equal. model: model of the
    set; values that have no effect by this model are left out. The time of a watchdog that is off is 0, never.
    """
    by_name: dict[str, list[ParameterEntry]] = {}
    for entry in known.of(parts):
        if entry.common:
            by_name.setdefault(entry.common, []).append(entry)
    found: dict[str, ParameterEntry] = {}
    left_out: dict[str, str] = {}
    for name, those in by_name.items():
        try:
            values = [_meant(entry, quantities()[name].unit, known, model) for entry in those]
        except (UsageError, ReplyError) as error:
            left_out[name] = str(error)
            continue
        if not all(same(values[0], value) for value in values):
            told = ", ".join(f"{entry.address} is {entry}" for entry in those)
            left_out[name] = f"it has no single value: {told}"
            continue
        first = those[0]
        found[name] = ParameterEntry(
            address=name,
            value=values[0],
            name=f"{first.parameter} {first.name}".rstrip(),
            unit=quantities()[name].unit,
            common=name,
            part=first.part,
        )
    return found, left_out


def _meant(entry: ParameterEntry, unit: str, known: ParameterSet, model: Model | None) -> Value:
    """Return a value in the unit of its common name. Raises UsageError for a value without effect."""
    if model is not None and is_watchdog_time(entry.address, model):
        return watchdog_setting(known, model).time_s or Decimal(0)
    if model is not None and (reason := without_effect(entry, known, model)):
        raise UsageError(reason)
    return in_unit(entry.value, entry.unit, unit)


def common_entries(
    to: SetSubject, known: ParameterSet, model: Model
) -> tuple[list[ParameterEntry], list[tuple[ParameterEntry, str]]]:
    """Return the entries with a common name that the drive's model maps, and the other entries with a reason each."""
    there = known.of(WRITABLE)
    found, left_out = common_values(known, WRITABLE, model)
    reasons = left_out | {
        name: f"model {to.model.name} does not map it" for name in found if name not in to.model.quantities
    }
    reasons |= {entry.address: "it has no common name" for entry in there if not entry.common}
    by_address = {entry.common or entry.address: entry for entry in there}
    left = [(replace(by_address[key], address=key), reason) for key, reason in reasons.items()]
    return [entry for name, entry in found.items() if name not in reasons], left


def is_about_watchdog(entry: ParameterEntry, to: SetSubject, model: Model) -> bool:
    """Return whether a common name is a watchdog time, on the drive or in the set. model: model of the set."""
    of_set = model.quantities.get(entry.common, "")
    return is_watchdog_time(to.model.quantities[entry.common], to.model) or is_watchdog_time(of_set, model)


def carried_watchdog(to: SetSubject, known: ParameterSet, model: Model) -> Procedure[list[tuple[ParameterInfo, Value]]]:
    """Return watchdog parameters that give this drive the same behaviour as the drive of the saved set.

    Reads the drive, writes nothing. Raises UsageError if the set does not contain the watchdog setting, or if this
    drive does not support it.
    """
    wanted = watchdog_setting(known, model)
    if wanted.policy is None:
        raise UsageError(f"the watchdog of {known.drive} does {wanted.action!r}, which no other maker's is known to do")
    now = yield from reading_watchdog(to.name, to.model)
    watchdog = to.model.watchdog
    assert watchdog is not None  # noqa: S101 - its setting was just read
    values = {watchdog.time: now.time_value}
    if now.action_value is not None:
        values[watchdog.action] = now.action_value
    held = StoredValues(to.name, values)
    carry_out(held.as_drive, setting_watchdog(to.name, to.model, wanted.policy, wanted.time_s or 0))
    return [(info, held.values[address]) for address in values if (info := to.info(address)) is not None]


def reason_not_to_count(to: SetSubject, entry: ParameterEntry) -> Procedure[str]:
    """Return why a common name has no effect on the drive in its present state, empty if it has an effect."""
    info = to.info(to.model.quantities[entry.common])
    for address in info.only_with if info else ():
        try:
            reading = yield read_parameter(address)
        except DriveError as error:
            return f"whether it counts is not known: {error}"
        if not counts_with(to.model, info, address, reading.value):
            return f"it would be without effect on this drive, because {address} {reading.name} is {reading}"
    return ""
