"""Whether a parameter set is of the drive that it is to be given to."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from drivecomm.commissioning.parameter_sets.parameter_set import ParameterSet
    from drivecomm.commissioning.parameter_sets.subject import Subject

# What a drive tells of itself and what may change while it stays the same drive.
_PASSING = ("state", "software", "firmware", "version", "hours")


def of_another_drive(known: ParameterSet, to: Subject, identity: Mapping[str, str]) -> str:
    """Return how one sees that a parameter set is of another drive; empty when nothing says so."""
    if known.protocol != to.protocol:
        return f"it is of a {known.protocol} drive, and {to.name} is none"
    if known.model != to.model.name:
        return f"it is of model {known.model}, and {to.name} is opened as {to.model.name}"
    if known.drive != to.name:
        return f"it is of {known.drive}, and the drive is {to.name}"
    return next(_differences(known.identity, identity), "")


def changes_told(before: ParameterSet, after: ParameterSet) -> list[str]:
    """Return what two sets of one drive say of it differently, as sentences."""
    told = list(_differences(before.identity, after.identity, "there"))
    if before.firmware != after.firmware and before.protocol == after.protocol:
        told.append(f"firmware is {before.firmware or 'not known'} here and {after.firmware or 'not known'} there")
    return told


def _differences(before: Mapping[str, str], after: Mapping[str, str], where: str = "on this drive") -> Iterator[str]:
    for key, text in before.items():
        if key in after and after[key] != text and not any(word in key.lower() for word in _PASSING):
            yield f"its {key} is {text!r}, and {after[key]!r} {where}"
