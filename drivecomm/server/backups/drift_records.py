"""Records of a drive's drift, made from a comparison and the record before it. No I/O, no clock."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from drivecomm.commissioning.parameter_sets import in_order, in_unit, of_another_drive, same
from drivecomm.server.drift_state import DriveDrift, NotComparable, SetChange, differing, listed

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from drivecomm.commissioning.drift import Drift
    from drivecomm.commissioning.parameter_sets import ParameterEntry, ParameterSet
    from drivecomm.protocol import Value
    from drivecomm.server.drift_state import DriftKind


def drift_record(
    found: Drift, before: DriveDrift, *, read_s: float, first_s: Mapping[str, float], restore: str
) -> DriveDrift:
    """Return the drift record of a drive after a comparison.

    read_s: when the drive was read. first_s: by address, when a current value was first seen, if earlier. restore: the
    command that writes the approved set to another drive.
    """
    goes_on = found.replaced == before.replaced
    earlier = {each.address: each for each in before.changes} if goes_on else {}
    changes: dict[str, SetChange] = {}
    for each in found.changed:
        if each.left is not None and each.right is not None:
            now, unit = each.right.value, each.right.unit
            last = earlier.get(each.address)
            since_s = last.since_s if last and _is_value(last, now, unit) else first_s.get(each.address, read_s)
            changes[each.address] = SetChange(
                address=each.address, name=each.name, unit=unit, now=now, since_s=since_s,
                approved=in_unit(each.left.value, each.left.unit, unit),
            )  # fmt: skip
    # A lost reply does not prove that a parameter is as approved again.
    unread = {*found.in_ram, *(each.address for each in found.not_comparable)}
    for address in unread & earlier.keys():
        if (approved := found.approved.entries.get(address)) and _is_approved(earlier[address], approved):
            changes[address] = earlier[address]
    state: DriftKind = "as approved" if found.same else "not comparable"
    approval = found.approved.approved
    replaced_s = before.replaced_since_s if goes_on else read_s
    return DriveDrift(
        state="replaced" if found.replaced else "changed" if changes else state,
        changes=tuple(changes[address] for address in in_order(changes)),
        replaced=found.replaced,
        replaced_since_s=replaced_s if found.replaced else None,
        restore=restore if found.replaced else "",
        not_comparable=tuple(NotComparable(address=each.address, reason=each.reason) for each in found.not_comparable),
        untold=found.untold,
        equal=found.equal,
        approved_by=approval.by if approval else "",
        approved_s=approval.time.timestamp() if approval else None,
        compared_s=read_s,
    )


def newly_changed(found: Drift, before: DriveDrift) -> dict[str, ParameterEntry]:
    """Return the current values that were not recorded before, by address; they are searched for in the backups."""
    earlier = {each.address: each for each in before.changes} if found.replaced == before.replaced else {}
    return {
        each.address: each.right
        for each in found.changed
        if each.right is not None
        and not ((last := earlier.get(each.address)) and _is_value(last, each.right.value, each.right.unit))
    }


def first_seen(
    wanted: Mapping[str, ParameterEntry], now: ParameterSet, backups: Iterable[tuple[float, ParameterSet]]
) -> dict[str, float]:
    """Return the time since which each of these values was seen unchanged, by address.

    backups: times and sets of the same shelf, the newest first; only as many are read as needed.
    """
    looked_for, found = dict(wanted), dict[str, float]()
    for time_s, known in backups:
        if not looked_for or of_another_drive(known, now):
            break
        for address, entry in list(looked_for.items()):
            if (there := known.entries.get(address)) is None:
                continue
            if there.unit == entry.unit and same(there.value, entry.value):
                found[address] = time_s
            else:
                del looked_for[address]
    return found


def news(before: DriveDrift, now: DriveDrift, writers: Mapping[str, str]) -> list[tuple[bool, str]]:
    """Return the news of a comparison for people, each as (whether it is a warning, text).

    writers: by address, the caller of a change, as text to append.
    """
    if now.replaced:
        if now.replaced == before.replaced:
            return []
        return [(True, f"replaced by another drive: {now.replaced}; to give it the approved set: {now.restore}")]
    found = [(False, "the drive of its baseline is back")] if before.replaced else []
    earlier, there = ({each.address: each for each in known.changes} for known in (before, now))
    new = [
        f"{each}{writers.get(address, '')}"
        for address, each in there.items()
        if address not in earlier or replace(each, since_s=0.0) != replace(earlier[address], since_s=0.0)
    ]
    back = [f"{each.address} {each.name}".rstrip() for address, each in earlier.items() if address not in there]
    if new:
        found.append((True, f"not set as approved, {differing(len(there))}: {listed(new)}"))
    if back and not before.replaced:
        by = f" by the new baseline of {now.approved_by}" if now.approved_s != before.approved_s else ""
        still = differing(len(there)) if there else "nothing differs"
        found.append((False, f"set as approved again{by}, {still}: {listed(back)}"))
    return found


def _is_value(change: SetChange, value: Value, unit: str) -> bool:
    return change.unit == unit and same(change.now, value)


def _is_approved(change: SetChange, approved: ParameterEntry) -> bool:
    return same(in_unit(approved.value, approved.unit, change.unit), change.approved)
