"""Comparison of two parameter sets: of one drive at two times, of two drives, or of two makers."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, TypeAlias

from drivecomm.commissioning.parameter_sets.effect import common_values, model_of
from drivecomm.commissioning.parameter_sets.parameter_set import SETTINGS, in_order, in_unit, same
from drivecomm.commissioning.parameter_sets.reading_out import identity_changes
from drivecomm.commissioning.parameter_sets.share import share_of
from drivecomm.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from drivecomm.commissioning.parameter_sets.parameter_set import ParameterEntry, ParameterSet, Part
    from drivecomm.commissioning.parameter_sets.share import Share
    from drivecomm.protocol import Model, Value

DifferenceKind: TypeAlias = Literal["value", "missing", "not comparable"]
"""Kind of difference between two sets.

value: both sets have the parameter and the values differ. missing: only one set has it. not comparable: the values
cannot be compared, for a stated reason.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """One parameter that differs. address: the common name instead, if two makers are compared."""

    kind: DifferenceKind
    address: str
    left: ParameterEntry | None
    right: ParameterEntry | None
    reason: str = ""

    @property
    def name(self) -> str:
        """Name of the parameter in the model."""
        known = self.left or self.right
        return known.name if known else ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """Differences between two parameter sets.

    by: the key by which parameters were matched. equal: number of equal parameters. missing: parameters that only one
    set has. remarks: further facts as sentences. Neither missing parameters nor remarks make the sets different.
    shares: share of its drive that each set holds, None if no model is found by its name.
    """

    by: Literal["address", "common name"]
    differences: tuple[Difference, ...]
    equal: int
    missing: tuple[Difference, ...] = ()
    remarks: tuple[str, ...] = ()
    shares: tuple[Share | None, Share | None] = (None, None)

    @property
    def same(self) -> bool:
        """Whether all parameters that both sets have are comparable and equal."""
        return not self.differences


def compare(left: ParameterSet, right: ParameterSet, parts: Collection[Part] = SETTINGS) -> Comparison:
    """Compare two parameter sets: by address within a protocol, otherwise by common names in their units.

    Raises UsageError for sets that have nothing to compare.
    """
    models = [model_of(known) for known in (left, right)]
    shares = (_share(left, models[0]), _share(right, models[1]))
    return replace(_compared(left, right, parts, models), shares=shares)


def _share(known: ParameterSet, model: Model | None) -> Share | None:
    return None if model is None else share_of(known, model)


def _compared(
    left: ParameterSet, right: ParameterSet, parts: Collection[Part], models: Sequence[Model | None]
) -> Comparison:
    ours, theirs = left.of(parts), right.of(parts)
    remarks = identity_changes(left, right)
    if left.protocol == right.protocol:
        if left.model != right.model:
            remarks.insert(0, f"models differ: {left.model} here, {right.model} there")
        here, there = ({entry.address: entry for entry in entries} for entries in (ours, theirs))
        found, equal = _differences(here, there, left.not_read, right.not_read)
        if nowhere := set(left.not_read) & set(right.not_read):
            remarks.append(f"read on neither side: {', '.join(in_order(nowhere))}")
        return _comparison("address", found, equal, remarks)
    here, unclear = common_values(left, parts, models[0])
    there, unclear_there = common_values(right, parts, models[1])
    if not set(here) & set(there):
        raise UsageError(
            f"{left.protocol} and {right.protocol} drives share only parameters with common names, and these two sets "
            "have none in common; see whether their models map them under [quantities]"
        )
    found, equal = _differences(here, there, unclear, unclear_there)
    nameless = [sum(not entry.common for entry in entries) for entries in (ours, theirs)]
    remarks += [
        f"whether every value of {known.drive} counts is not known, because no model {known.model} is found by its name"
        for known, model in zip((left, right), models, strict=True)
        if model is None
    ]
    remarks.append(f"not compared, because there is no common name: {nameless[0]} here, {nameless[1]} there")
    return _comparison("common name", found, equal, remarks)


def _comparison(
    by: Literal["address", "common name"], found: list[Difference], equal: int, remarks: list[str]
) -> Comparison:
    return Comparison(
        by=by,
        differences=tuple(each for each in found if each.kind != "missing"),
        equal=equal,
        missing=tuple(each for each in found if each.kind == "missing"),
        remarks=tuple(remarks),
    )


def _differences(
    here: Mapping[str, ParameterEntry],
    there: Mapping[str, ParameterEntry],
    why_not: Mapping[str, str],
    why_not_there: Mapping[str, str],
) -> tuple[list[Difference], int]:
    found: list[Difference] = []
    equal = 0
    for address in in_order({*here, *there}):
        one, other = here.get(address), there.get(address)
        if one is None or other is None:
            reason = (why_not if one is None else why_not_there).get(address, "")
            kind: DifferenceKind = "not comparable" if reason else "missing"
            found.append(Difference(kind=kind, address=address, left=one, right=other, reason=reason))
            continue
        try:
            value, other_value = _comparable(one, other)
        except UsageError as error:
            reason = str(error)
            found.append(Difference(kind="not comparable", address=address, left=one, right=other, reason=reason))
            continue
        if same(value, other_value):
            equal += 1
        else:
            found.append(Difference(kind="value", address=address, left=one, right=other))
    return found, equal


def _comparable(one: ParameterEntry, other: ParameterEntry) -> tuple[Value, Value]:
    """Return two values in one unit, or as the telegrams carried them if one model does not know the parameter.

    Raises UsageError if this does not show whether the values are equal.
    """
    if "unknown" not in (one.part, other.part):
        return in_unit(one.value, one.unit, other.unit), other.value
    if one.part != other.part and not same(one.carried, other.carried):
        raise UsageError("only one side knows its type, and what was sent is not the same")
    return one.carried, other.carried
