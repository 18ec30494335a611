"""What a restore would write, and what not and why; the dry run."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, TypeAlias

from drivecomm.errors import DriveError, NotSupported, UsageError, ValueRefusedError
from drivecomm.parameter_sets.common_values import common_values
from drivecomm.parameter_sets.identity import of_another_drive
from drivecomm.parameter_sets.ordering import Stage, stage_of
from drivecomm.parameter_sets.parameter_set import in_order
from drivecomm.parameter_sets.reading_out import identity_told
from drivecomm.parameter_sets.subject import part_of
from drivecomm.parameter_sets.values import in_unit, same
from drivecomm.steps import CheckWrite, Read

if TYPE_CHECKING:
    from drivecomm.models import ParameterInfo
    from drivecomm.parameter_sets.parameter_set import Entry, ParameterSet
    from drivecomm.parameter_sets.reading_out import Progress
    from drivecomm.parameter_sets.subject import Subject
    from drivecomm.parameter_sets.wishes import Wishes
    from drivecomm.reading import Value
    from drivecomm.steps import Steps

Action: TypeAlias = Literal["write", "equal", "skip"]
"""write: its value is another one. equal: it has the value already. skip: it is left alone, and why."""

_SHOWN = 3
_NOT_TOLD = "communication settings are only written when that is said (--communication)"


@dataclass(frozen=True, slots=True, kw_only=True)
class Planned:
    """What becomes of one entry of a parameter set.

    address: on the drive, or a common name. value, unit: what it is to be, in the drive's unit. current: what it is
    now, None where the drive does not tell.
    """

    action: Action
    address: str
    name: str
    value: Value
    unit: str
    stage: Stage
    current: Value | None = None
    reason: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """What a restore would do, in its order. store: whether writes are kept over power-off, as far as is known."""

    drive: str
    store: bool
    items: tuple[Planned, ...]
    remarks: tuple[str, ...] = ()

    def to(self, action: Action) -> list[Planned]:
        """Return the entries of which this becomes."""
        return [item for item in self.items if item.action == action]


def planning(to: Subject, known: ParameterSet, wishes: Wishes, progress: Progress) -> Steps[Plan]:
    """Find out what a restore would write; writes nothing.

    Raises UsageError for a set of another drive unless that is wished, and ValueRefusedError when a value does not fit.
    """
    store = _stored(to, wishes)
    remarks = yield from _looked_at(to, known, wishes)
    entries, skipped = _entries(to, known)
    chosen, without = _chosen(entries, wishes)
    items = [*skipped] if not wishes.only else []
    wanted: list[Planned] = []
    for entry in chosen:
        item = _item(to, entry, wishes, across=known.protocol != to.protocol)
        (items if item.action == "skip" else wanted).append(item)
    wanted, unfit, wrong = yield from _checked(wanted, store=store)
    items += unfit
    for done, item in enumerate(wanted):
        progress(item.address, done, len(wanted))
        items.append((yield from _compared(item)))
    progress("", len(wanted), len(wanted))
    _must_fit(items, wrong)
    order = {address: place for place, address in enumerate(in_order(item.address for item in items))}
    items.sort(key=lambda item: (item.stage, order[item.address]))
    if without:
        remarks.append(f"{without} not asked for")
    return Plan(drive=to.name, store=store, items=tuple(items), remarks=tuple(remarks))


def _stored(to: Subject, wishes: Wishes) -> bool:
    if not wishes.volatile:
        return to.capabilities.stored_writes
    if not to.capabilities.volatile_writes:
        raise NotSupported(f"{to.name} keeps every write over power-off, or nobody knows; restore without volatile")
    return False


def _looked_at(to: Subject, known: ParameterSet, wishes: Wishes) -> Steps[list[str]]:
    identity = yield from identity_told()
    if reason := of_another_drive(known, to, identity):
        if not wishes.another_drive:
            raise UsageError(
                f"this parameter set is of another drive: {reason}; nothing was written; say that it is meant for "
                "another drive (--another-drive) if it is"
            )
        return [f"from another drive: {reason}"]
    return []


def _entries(to: Subject, known: ParameterSet) -> tuple[list[Entry], list[Planned]]:
    """Return what could be restored; for a drive of another maker, what has a common name that its model maps."""
    there = known.of(["settings", "communication"])
    if known.protocol == to.protocol:
        return there, []
    found, left_out = common_values(there)
    reasons = left_out | {
        name: f"model {to.model.name} does not map it" for name in found if name not in to.model.quantities
    }
    reasons |= {entry.address: "it has no common name" for entry in there if not entry.common}
    by_address = {entry.common or entry.address: entry for entry in there}
    skipped = [_skipped(replace(by_address[key], address=key), reason) for key, reason in reasons.items()]
    return [entry for name, entry in found.items() if name not in reasons], skipped


def _chosen(entries: list[Entry], wishes: Wishes) -> tuple[list[Entry], int]:
    if not wishes.only:
        return entries, 0
    named = {entry.address: {entry.address, entry.parameter, entry.name, entry.common} for entry in entries}
    unknown = sorted(wishes.only - set().union(*named.values()))
    if unknown:
        raise UsageError(f"the parameter set has no {unknown[0]!r}; name what is in it, by address or name")
    chosen = [entry for entry in entries if named[entry.address] & wishes.only]
    return chosen, len(entries) - len(chosen)


def _item(to: Subject, entry: Entry, wishes: Wishes, *, across: bool) -> Planned:
    info = to.info(to.model.quantities[entry.common] if across else entry.address)
    if info is None:
        return _skipped(entry, f"model {to.model.name} has no such parameter")
    reason = _reason_to_skip(entry, info, wishes, across=across)
    if reason:
        return _skipped(entry, reason, info)
    unit = entry.unit if across else info.unit
    try:
        value = in_unit(entry.value, entry.unit, unit)
    except UsageError as error:
        return _skipped(entry, f"unit: {error}", info)
    return Planned(
        action="write",
        address=entry.address,
        name=info.name,
        value=value,
        unit=unit,
        stage=stage_of(info, entry.common),
    )


def _reason_to_skip(entry: Entry, info: ParameterInfo, wishes: Wishes, *, across: bool) -> str:
    if not across and entry.name and entry.name != info.name:
        return f"it is {entry.name} in the set and {info.name} on this drive"
    part = part_of(info)
    if part is None:
        return "writing it is a command"
    if part == "measured":
        return "it can only be read" if "w" not in info.access else "it is gone without power"
    if "communication" in (part, entry.part):
        if across:
            return "how a drive is spoken to is no matter of another maker's"
        if not wishes.communication:
            return _NOT_TOLD
    return ""


def _skipped(entry: Entry, reason: str, info: ParameterInfo | None = None) -> Planned:
    return Planned(
        action="skip",
        address=entry.address,
        name=info.name if info else entry.name,
        value=entry.value,
        unit=entry.unit,
        stage=stage_of(info, entry.common) if info else Stage.VALUES,
        reason=reason,
    )


def _checked(wanted: list[Planned], *, store: bool) -> Steps[tuple[list[Planned], list[Planned], dict[str, str]]]:
    """Return what can be asked for, what cannot be sent by itself, and the values that do not fit, by address."""
    fit, unfit, wrong = [], [], {}
    for item in wanted:
        try:
            yield CheckWrite(item.address, item.value, store)
        except ValueRefusedError as error:
            wrong[item.address] = f"{item.address} {item.name}: {error}"
        except UsageError as error:
            unfit.append(replace(item, action="skip", reason=str(error)))
            continue
        fit.append(item)
    return fit, unfit, wrong


def _must_fit(items: list[Planned], wrong: dict[str, str]) -> None:
    """Raise ValueRefusedError for values that do not fit, unless the drive holds them all the same."""
    told = [wrong[item.address] for item in items if item.action == "write" and item.address in wrong]
    if told:
        more = f" (and {len(told) - _SHOWN} more)" if len(told) > _SHOWN else ""
        raise ValueRefusedError(
            f"{'; '.join(told[:_SHOWN])}{more}; nothing was written, set this right in the parameter set first"
        )


def _compared(item: Planned) -> Steps[Planned]:
    try:
        reading = yield Read(item.address)
    except DriveError:
        # Data sets that differ, say: what is to be there is known all the same.
        return item
    return replace(item, action="equal" if same(reading.value, item.value) else "write", current=reading.value)
