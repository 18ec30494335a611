"""What differs in a drive from its approved set, and whether it is the same drive at all."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from drivecomm.commissioning.exploring import lasting
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
    from drivecomm.commissioning.parameter_sets import Difference, ParameterSet, Subject


@dataclass(frozen=True, slots=True, kw_only=True)
class Drift:
    """What is not as it was approved. In each difference, left is approved and right is now.

    replaced: how one sees that another drive is there, empty where nothing says so. untold: what the drive told of
    itself then, and does not tell now, so that it may be another one. changed: what has another value. not_comparable:
    what could be read only once, with the reason. These four are drift; the rest is not. equal: how many are as
    approved. never_read: read neither then nor now. in_ram: written to RAM only, by the program that reads. unapproved:
    settings that the approved set does not have.
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
        """Whether the same drive is there, and all that is approved was read and has its approved value."""
        return not (self.replaced or self.changed or self.not_comparable or self.untold)


def drift_between(approved: ParameterSet, now: ParameterSet, live: Collection[str] = ()) -> Drift:
    """Return what differs in a drive as it is now from its approved set.

    live: addresses that change by themselves, and never count, though an older set may have them as settings.
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
        untold=tuple(key for key in lasting(approved.identity) if key not in now.identity),
        equal=found.equal,
        never_read=tuple(in_order({*approved.not_read} & {*now.not_read})),
        in_ram=tuple(each.address for each in apart if each.reason == IN_RAM),
        unapproved=tuple(each.address for each in found.missing if each.left is None),
    )


def live_addresses(of: Subject) -> frozenset[str]:
    """Return the addresses of what a drive shows or is commanded, which never counts as drift."""
    return frozenset(address for address, _, part in of.values_known() if part not in WRITABLE)


def read_drift(
    drive: Drive, approved: ParameterSet, *, progress: Callable[[str, int, int], None] = no_progress
) -> Drift:
    """Read the settings of a drive, and return what differs from its approved set.

    progress: as of `back_up`. Raises UsageError for a drive without a model, ReplyError and LinkError when drive or
    line are away.
    """
    return drift_between(approved, back_up(drive, progress=progress), live_addresses(subject(drive)))
