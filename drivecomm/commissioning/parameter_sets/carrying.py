"""Carrying settings from one maker's drive to another maker's: by common names, and by what they do, not by numbers."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from drivecomm.bus import carry_out, read_parameter, reading_watchdog, setting_watchdog
from drivecomm.commissioning.parameter_sets.effect import (
    Held,
    common_values,
    counts_with,
    is_watchdog_time,
    watchdog_told,
)
from drivecomm.commissioning.parameter_sets.parameter_set import WRITABLE
from drivecomm.errors import DriveError, UsageError

if TYPE_CHECKING:
    from drivecomm.bus import Procedure
    from drivecomm.commissioning.parameter_sets.parameter_set import Entry, ParameterSet
    from drivecomm.commissioning.parameter_sets.subject import Subject
    from drivecomm.protocol import Model, ParameterInfo, Value


def common_entries(to: Subject, known: ParameterSet, model: Model) -> tuple[list[Entry], list[tuple[Entry, str]]]:
    """Return what of a set has a common name that the drive's model maps, and the rest with the reason of each."""
    there = known.of(WRITABLE)
    found, left_out = common_values(known, WRITABLE, model)
    reasons = left_out | {
        name: f"model {to.model.name} does not map it" for name in found if name not in to.model.quantities
    }
    reasons |= {entry.address: "it has no common name" for entry in there if not entry.common}
    by_address = {entry.common or entry.address: entry for entry in there}
    left = [(replace(by_address[key], address=key), reason) for key, reason in reasons.items()]
    return [entry for name, entry in found.items() if name not in reasons], left


def is_about_watchdog(entry: Entry, to: Subject, model: Model) -> bool:
    """Whether a common name is the time of a watchdog, on the drive or in the set, which model is of."""
    of_set = model.quantities.get(entry.common, "")
    return is_watchdog_time(to.model.quantities[entry.common], to.model) or is_watchdog_time(of_set, model)


def carried_watchdog(to: Subject, known: ParameterSet, model: Model) -> Procedure[list[tuple[ParameterInfo, Value]]]:
    """Return what the parameters of the drive's watchdog are to be, so that it does what that of the set did.

    Reads the drive, writes nothing. Raises UsageError where the set does not tell it, or this drive cannot do it.
    """
    wanted = watchdog_told(known, model)
    if wanted.policy is None:
        raise UsageError(f"the watchdog of {known.drive} does {wanted.action!r}, which no other maker's is known to do")
    now = yield from reading_watchdog(to.name, to.model)
    watchdog = to.model.watchdog
    assert watchdog is not None  # noqa: S101 - its setting was just read
    values = {watchdog.time: now.time_value}
    if now.action_value is not None:
        values[watchdog.action] = now.action_value
    held = Held(to.name, values)
    carry_out(held.as_drive, setting_watchdog(to.name, to.model, wanted.policy, wanted.time_s or 0))
    return [(info, held.values[address]) for address in values if (info := to.info(address)) is not None]


def reason_not_to_count(to: Subject, entry: Entry) -> Procedure[str]:
    """Return why a common name counts for nothing on the drive as it is, empty where it counts."""
    info = to.info(to.model.quantities[entry.common])
    for address in info.only_with if info else ():
        try:
            reading = yield read_parameter(address)
        except DriveError as error:
            return f"whether it counts is not known: {error}"
        if not counts_with(to.model, info, address, reading.value):
            return f"it would be without effect on this drive, because {address} {reading.name} is {reading}"
    return ""
