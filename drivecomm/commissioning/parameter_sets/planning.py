"""Planning of a restore: the parameters to write, and those to leave alone with the reason; the dry run."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from drivecomm.bus import check_write, read_parameter
from drivecomm.commissioning.exploring import read_identity
from drivecomm.commissioning.parameter_sets.effect import (
    carried_watchdog,
    common_entries,
    is_about_watchdog,
    model_of,
    reason_not_to_count,
)
from drivecomm.commissioning.parameter_sets.parameter_set import WRITABLE, ParameterSet, in_order, in_unit, same
from drivecomm.commissioning.parameter_sets.raw_numbers import as_raw_number, raw_number, same_scale
from drivecomm.commissioning.parameter_sets.reading_out import of_another_drive, part_of
from drivecomm.commissioning.parameter_sets.restore_plan import (
    PlannedItem,
    RestoreOptions,
    RestorePlan,
    Stage,
    stage_of,
)
from drivecomm.errors import DriveError, NotSupported, ReadOnlyError, UsageError, ValueRefusedError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from typing import Any

    from drivecomm.bus import Procedure
    from drivecomm.commissioning.parameter_sets.parameter_set import ParameterEntry
    from drivecomm.commissioning.parameter_sets.reading_out import Progress, SetSubject
    from drivecomm.protocol import Model, ParameterInfo

_SHOWN = 3
_REFERENCE = "a bus commands the motor's speed with it"
_WATCHDOG = "a bus switches the watchdog on for a time; name it with --only to restore it"
_NOT_TOLD = "communication settings are only written with --communication"
_AS_MEANT = (_REFERENCE, _WATCHDOG, _NOT_TOLD)


def planning(
    to: SetSubject, known: ParameterSet, options: RestoreOptions, progress: Progress
) -> Procedure[RestorePlan]:
    """Plan a restore; writes nothing.

    Raises UsageError for a set of another drive unless the options allow it and for a read-only drive, and
    ValueRefusedError if a value of a set of the same protocol does not fit.
    """
    store = _stored(to, options)
    remarks, own = yield from _looked_at(to, known, options)
    across = known.protocol != to.protocol
    model = _model_of(known) if across else to.model
    if across:
        # Another maker's drive gets only parameters whose common names its model maps.
        entries, left = common_entries(to, known, model)
        skipped = [_skipped(entry, reason) for entry, reason in left]
    else:
        entries, skipped = known.of(WRITABLE), []
    entries, skipped, without = _chosen(entries, skipped, options)
    items = list(skipped)
    wanted: list[PlannedItem] = []
    for entry in entries:
        for item in (yield from _items(to, entry, known, model, options, across=across, own=own)):
            (items if item.action == "skip" else wanted).append(item)
    wanted, unfit, wrong = yield from _checked(wanted, to.plugin.plain_writing, store=store)
    for done, item in enumerate(wanted):
        progress(item.address, done, len(wanted))
        items.append((yield from _compared(item, to.plugin.plain_writing, store=store)))
    for item in unfit:
        found = yield from _compared(replace(item, action="write", told=None), {}, store=store)
        items.append(found if found.action == "equal" else replace(found, action="skip"))
    progress("", len(wanted), len(wanted))
    if across:
        items = [
            replace(item, action="skip", reason=wrong[item.address])
            if item.action == "write" and item.address in wrong
            else item
            for item in items
        ]
    else:
        _must_fit(items, wrong)
    of_same_model = not across and known.model == to.model.name
    items = [
        replace(
            item,
            missed=item.action == "skip" and bool(options.only or (of_same_model and item.reason not in _AS_MEANT)),
        )
        for item in items
    ]
    order = {address: place for place, address in enumerate(in_order(item.address for item in items))}
    items.sort(key=lambda item: (item.stage, order[item.address]))
    if unknown := known.of(("unknown",)):
        count = f"{len(unknown)} value{'s' if len(unknown) > 1 else ''}"
        remarks.append(f"{count} left alone, because model {known.model} does not know their types")
    if known.not_read and not options.only:
        remarks.append(f"not in the set, because it could not be read: {', '.join(in_order(known.not_read))}")
    if without:
        remarks.append(f"{without} not asked for")
    return RestorePlan(drive=to.name, store=store, items=tuple(items), remarks=tuple(remarks))


def _stored(to: SetSubject, options: RestoreOptions) -> bool:
    if not options.volatile:
        return to.capabilities.stored_writes
    if not to.capabilities.volatile_writes:
        raise NotSupported(f"{to.name} keeps every write over power-off, or this is unknown; restore without volatile")
    return False


def _looked_at(to: SetSubject, known: ParameterSet, options: RestoreOptions) -> Procedure[tuple[list[str], bool]]:
    """Compare the identities of the set and the drive; return remarks, and whether the set is of this drive."""
    identity = yield from read_identity()
    there = ParameterSet(protocol=to.protocol, drive=to.name, model=to.model.name, identity=identity, entries={})
    if reason := of_another_drive(known, there):
        if not options.another_drive:
            raise UsageError(
                f"this parameter set is of another drive: {reason}; nothing was written; if it is meant for another "
                "drive, give --another-drive"
            )
        return [f"from another drive: {reason}"], False
    return [], True


def _model_of(known: ParameterSet) -> Model:
    model = model_of(known)
    if model is None:
        raise UsageError(
            f"the values of {known.drive} need its model {known.model}, and {known.protocol} has no model of that "
            f"name; put its file where models are found; nothing was written"
        )
    return model


def _chosen(
    entries: list[ParameterEntry], skipped: list[PlannedItem], options: RestoreOptions
) -> tuple[list[ParameterEntry], list[PlannedItem], int]:
    """Return the entries and skipped items that the options select, and the number of the others."""
    if not options.only:
        return entries, skipped, 0
    # An entry under a common name has the address and the name of the other maker as its name.
    named = {
        entry.address: {entry.address, entry.parameter, entry.name, entry.common, *entry.name.split()}
        for entry in entries
    }
    named |= {item.address: {item.address, item.address.partition("[")[0], item.name} for item in skipped}
    unknown = sorted(options.only - set().union(*named.values()))
    if unknown:
        raise UsageError(f"the parameter set has no {unknown[0]!r}; name what is in it, by address or name")
    chosen = [entry for entry in entries if named[entry.address] & options.only]
    left = [item for item in skipped if named[item.address] & options.only]
    return chosen, left, len(named) - len(chosen) - len(left)


def _items(
    to: SetSubject,
    entry: ParameterEntry,
    known: ParameterSet,
    model: Model,
    options: RestoreOptions,
    *,
    across: bool,
    own: bool,
) -> Procedure[list[PlannedItem]]:
    """Return the planned items of an entry; another maker's watchdog time becomes all parameters of a watchdog."""
    if not across:
        return [_item(to, entry, options, across=False, own=own)]
    if is_about_watchdog(entry, to, model):
        if not options.only:
            return [_skipped(entry, _WATCHDOG, to.info(to.model.quantities[entry.common]))]
        try:
            values = yield from carried_watchdog(to, known, model)
        except UsageError as error:
            return [_skipped(entry, str(error))]
        return [
            PlannedItem(action="write", address=info.address, name=info.name, value=value, unit=info.unit,
                    stage=Stage.WATCHDOG)
            for info, value in values
        ]  # fmt: skip
    item = _item(to, entry, options, across=True, own=False)
    if item.action == "write" and (reason := (yield from reason_not_to_count(to, entry))):
        return [_skipped(entry, reason, to.info(to.model.quantities[entry.common]))]
    return [item]


def _item(to: SetSubject, entry: ParameterEntry, options: RestoreOptions, *, across: bool, own: bool) -> PlannedItem:
    info = to.info(to.model.quantities[entry.common] if across else entry.address)
    if info is None:
        return _skipped(entry, f"model {to.model.name} has no such parameter")
    reason = _reason_to_skip(to, entry, info, options, across=across)
    if reason:
        return _skipped(entry, reason, info)
    unit, plain = (entry.unit if across else info.unit), {}
    try:
        value = in_unit(entry.value, entry.unit, unit)
    except UsageError as error:
        # The raw number means the same to the drive that reported it, whatever its scale.
        if not own or entry.unit or not to.plugin.plain_writing:
            return _skipped(entry, f"unit: {error}", info)
        value, unit, plain = entry.value, "", dict(to.plugin.plain_writing)
    return PlannedItem(
        action="write",
        address=entry.address,
        name=info.name,
        value=value,
        unit=unit,
        stage=stage_of(info, entry.common, to.model.watchdog),
        options=plain,
        told=raw_number(entry) if own and not plain and to.plugin.plain_writing else None,
    )


def _reason_to_skip(
    to: SetSubject, entry: ParameterEntry, info: ParameterInfo, options: RestoreOptions, *, across: bool
) -> str:
    if not across and entry.name and entry.name != info.name:
        return f"it is {entry.name} in the set and {info.name} on this drive"
    if info.address in to.references:
        return _REFERENCE
    watchdog = to.model.watchdog
    if watchdog is not None and not options.only and info.address in (watchdog.time, watchdog.action):
        return _WATCHDOG
    part = part_of(info, to.references)
    if part is None:
        return "writing it is a command"
    if part == "measured":
        return "it can only be read" if "w" not in info.access else "it is lost at power-off"
    if "communication" in (part, entry.part):
        if across:
            return "communication settings are not copied between makers"
        if not options.communication:
            return _NOT_TOLD
    return ""


def _skipped(entry: ParameterEntry, reason: str, info: ParameterInfo | None = None) -> PlannedItem:
    return PlannedItem(
        action="skip",
        address=entry.address,
        name=info.name if info else entry.name,
        value=entry.value,
        unit=entry.unit,
        stage=stage_of(info, entry.common) if info else Stage.VALUES,
        reason=reason,
    )


def _checked(
    wanted: list[PlannedItem], plain: Mapping[str, Any], *, store: bool
) -> Procedure[tuple[list[PlannedItem], list[PlannedItem], dict[str, str]]]:
    """Return the items that can be written, those that cannot be sent by themselves, and unfit values by address."""
    fit, unfit, wrong = [], [], {}
    for item in wanted:
        try:
            yield check_write(item.address, item.value, store=store, options=item.options)
        except ReadOnlyError as error:
            raise ReadOnlyError(f"{error}; nothing was written") from error
        except ValueRefusedError as error:
            as_number = yield from _number_that_fits(item, plain, store=store)
            if as_number is not None:
                fit.append(as_number)
                continue
            wrong[item.address] = f"{item.address} {item.name}: {error}"
        except UsageError as error:
            unfit.append(replace(item, action="skip", reason=str(error)))
            continue
        fit.append(item)
    return fit, unfit, wrong


def _number_that_fits(item: PlannedItem, plain: Mapping[str, Any], *, store: bool) -> Procedure[PlannedItem | None]:
    """Return the item with the raw number that the drive reported, None if the drive does not accept that number."""
    if item.told is None:
        return None
    found = as_raw_number(item, plain)
    try:
        yield check_write(found.address, found.value, store=store, options=found.options)
    except UsageError:
        return None
    return found


def _must_fit(items: list[PlannedItem], wrong: dict[str, str]) -> None:
    """Raise ValueRefusedError for values that do not fit, unless the drive already holds them."""
    told = [wrong[item.address] for item in items if item.action == "write" and item.address in wrong]
    if told:
        more = f" (and {len(told) - _SHOWN} more)" if len(told) > _SHOWN else ""
        raise ValueRefusedError(
            f"{'; '.join(told[:_SHOWN])}{more}; nothing was written; correct the parameter set first"
        )


def _compared(item: PlannedItem, plain: Mapping[str, Any], *, store: bool) -> Procedure[PlannedItem]:
    try:
        reading = yield read_parameter(item.address)
    except DriveError:
        # A drive may refuse to report data sets that differ; the value to write is known all the same.
        return item
    if item.told is not None and not same_scale(item, reading):
        item = (yield from _number_that_fits(item, plain, store=store)) or item
    held = item.held_by(reading)
    return replace(item, action="equal" if same(held, item.value) else "write", current=held)
