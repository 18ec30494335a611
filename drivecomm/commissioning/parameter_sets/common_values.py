"""The values of a parameter set by their common names, in the units of those: what drives of every maker share."""

from __future__ import annotations

from decimal import Decimal
from typing import TYPE_CHECKING

from drivecomm.commissioning.parameter_sets.effect import is_watchdog_time, watchdog_told, without_effect
from drivecomm.commissioning.parameter_sets.parameter_set import Entry
from drivecomm.commissioning.parameter_sets.values import in_unit, same
from drivecomm.errors import ReplyError, UsageError
from drivecomm.models import quantities

if TYPE_CHECKING:
    from collections.abc import Collection

    from drivecomm.commissioning.parameter_sets.parameter_set import ParameterSet, Part
    from drivecomm.protocol import Model, Value


def common_values(
    known: ParameterSet, parts: Collection[Part], model: Model | None
) -> tuple[dict[str, Entry], dict[str, str]]:
    """Return one entry for each common name, with that for its address, and why others have none.

    A parameter with several values, one for each data set, has one where all of them are the same. model: of the set,
    which says what counts for nothing; such a value is left out. The time of a watchdog that is off is 0, never.
    """
    by_name: dict[str, list[Entry]] = {}
    for entry in known.of(parts):
        if entry.common:
            by_name.setdefault(entry.common, []).append(entry)
    found: dict[str, Entry] = {}
    left_out: dict[str, str] = {}
    for name, those in by_name.items():
        try:
            values = [_meant(entry, quantities()[name].unit, known, model) for entry in those]
        except (UsageError, ReplyError) as error:
            left_out[name] = str(error)
            continue
        if not all(same(values[0], value) for value in values):
            told = ", ".join(f"{entry.address} is {entry}" for entry in those)
            left_out[name] = f"it has no one value: {told}"
            continue
        first = those[0]
        found[name] = Entry(
            address=name,
            value=values[0],
            name=f"{first.parameter} {first.name}".rstrip(),
            unit=quantities()[name].unit,
            common=name,
            part=first.part,
        )
    return found, left_out


def _meant(entry: Entry, unit: str, known: ParameterSet, model: Model | None) -> Value:
    """Return what a value means in the unit of its common name. Raises UsageError for one that counts for nothing."""
    if model is not None and is_watchdog_time(entry.address, model):
        return watchdog_told(known, model).time_s or Decimal(0)
    if model is not None and (reason := without_effect(entry, known, model)):
        raise UsageError(reason)
    return in_unit(entry.value, entry.unit, unit)
