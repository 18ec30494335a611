"""The values of a parameter set by their common names, in the units of those: what drives of every maker share."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.errors import UsageError
from drivecomm.models.quantities import quantities
from drivecomm.parameter_sets.parameter_set import Entry
from drivecomm.parameter_sets.values import in_unit, same

if TYPE_CHECKING:
    from collections.abc import Iterable


def common_values(entries: Iterable[Entry]) -> tuple[dict[str, Entry], dict[str, str]]:
    """Return one entry for each common name, with that for its address, and why others have none.

    A parameter with several values, one for each data set, has one where all of them are the same.
    """
    by_name: dict[str, list[Entry]] = {}
    for entry in entries:
        if entry.common:
            by_name.setdefault(entry.common, []).append(entry)
    found: dict[str, Entry] = {}
    left_out: dict[str, str] = {}
    for name, those in by_name.items():
        try:
            values = [in_unit(entry.value, entry.unit, quantities()[name].unit) for entry in those]
        except UsageError as error:
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
