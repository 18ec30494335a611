"""Differences between a drive and its approved set, and evidence that it is another drive."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from drivecomm.commissioning.exploring import lasting_identity
from drivecomm.commissioning.parameter_sets import (
    IN_RAM,
    WRITABLE,
    back_up,
    compare,
    in_order,
    no_progress,
    of_another_drive,
    subject,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

    from drivecomm.bus import Drive
    from drivecomm.commissioning.parameter_sets import Difference, ParameterSet, SetSubject


@dataclass(frozen=True, slots=True, kw_only=True)
class Drift:
    """Differences from the approved set. In each difference, left is approved and right is now.

    replaced: evidence that another drive is there, empty if there is none. untold: identity fields that the drive
    reported at approval and does not report now, so that it may be another drive. changed: settings with another value.
    not_comparable: settings that were read only then or only now, with the reason. These four are drift; the rest is
    not. equal: number of settings as approved. never_read: settings not read in either set. in_ram: settings written
    only to RAM, by the program that reads. unapproved: settings that the approved set does not have.
    """

    approved: ParameterSet
    now: ParameterSet
    replaced: str = ""
    changed: tuple[Difference, ...] = ()
    not_comparable: tuple[Difference, ...] = ()
    untold: tuple[str, ...] = ()
    equal: int = 0
    never_read: tuple[str, ...] = ()
    in_ram: tuple[str, ...] = ()
    unapproved: tuple[str, ...] = ()

    @property
    def same(self) -> bool:
        """Whether the same drive is there, and every approved setting was read and has its approved value."""
        return not (self.replaced or self.changed or self.not_comparable or self.untold)


def drift_between(approved: ParameterSet, now: ParameterSet, live: Collection[str] = ()) -> Drift:
    """Return the differences between a drive as it is now and its approved set.

    live: addresses that change by themselves. They never count, even if an older set has them as settings.
    """
    replaced = of_another_drive(approved, now)
    if approved.protocol != now.protocol:
        return Drift(approved=approved, now=now, replaced=replaced)
    settings = {address: entry for address, entry in approved.entries.items() if address not in live}
    found = compare(replace(approved, entries=settings), now, WRITABLE)
    apart = [each for each in found.differences if each.kind == "not comparable"]
    gone = [
        replace(each, kind="not comparable", reason="the drive's model has no such setting now")
        for each in found.missing
        if each.right is None
    ]
    return Drift(
        approved=approved,
        now=now,
        replaced=replaced,
        changed=tuple(each for each in found.differences if each.kind == "value"),
        not_comparable=(*(each for each in apart if each.reason != IN_RAM), *gone),
        untold=tuple(key for key in lasting_identity(approved.identity) if key not in now.identity),
        equal=found.equal,
        never_read=tuple(in_order({*approved.not_read} & {*now.not_read})),
        in_ram=tuple(each.address for each in apart if each.reason == IN_RAM),
        unapproved=tuple(each.address for each in found.missing if each.left is None),
    )


def live_addresses(of: SetSubject) -> frozenset[str]:
    """Return the addresses of displayed values and commands, which never count as drift."""
    return frozenset(address for address, _, part in of.values_known() if part not in WRITABLE)


def read_drift(
    drive: Drive, approved: ParameterSet, *, progress: Callable[[str, int, int], None] = no_progress
) -> Drift:
    """Read the settings of a drive, and return its differences from the approved set.

    progress: see `back_up`. Raises UsageError for a drive without a model, ReplyError or LinkError if the drive or the
    line does not respond.
    """
    return drift_between(approved, back_up(drive, progress=progress), live_addresses(subject(drive)))
