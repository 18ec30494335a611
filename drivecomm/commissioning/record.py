"""The commissioning record of a drive: its identity and its settings when it is put into service."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivecomm.bus import Setting, read_watchdog
from drivecomm.commissioning.parameter_sets import back_up, compare, factory_set, no_progress
from drivecomm.errors import DriveError, UsageError

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.bus import Drive
    from drivecomm.commissioning.parameter_sets import Difference, ParameterEntry, ParameterSet


@dataclass(frozen=True, slots=True, kw_only=True)
class CommissioningRecord:
    """Identity and settings of a drive at one time.

    now: identity, firmware and parameters, with the time of reading. watchdog: the drive's reaction when its master
    falls silent; None if that cannot be read. differing: settings that differ from the factory values, left as
    delivered and right as they are now; None if the drive does not report its factory values.
    """

    now: ParameterSet
    watchdog: Setting | None
    differing: tuple[Difference, ...] | None

    @property
    def motor(self) -> tuple[ParameterEntry, ...]:
        """Name plate data of the motor, as set in the drive."""
        return tuple(entry for entry in self.now.entries.values() if entry.common.startswith("motor_rated_"))


def take_record(drive: Drive, *, progress: Callable[[str, int, int], None] = no_progress) -> CommissioningRecord:
    """Read a complete commissioning record from a drive; writes nothing.

    progress: see `back_up`. Raises UsageError for a drive without a model, ReplyError or LinkError if the drive or the
    line does not respond.
    """
    now = back_up(drive, progress=progress)
    try:
        watchdog = read_watchdog(drive)
    except (UsageError, DriveError):
        watchdog = None
    try:
        factory = factory_set(drive, progress=progress)
    except UsageError:
        return CommissioningRecord(now=now, watchdog=watchdog, differing=None)
    found = compare(factory, now)
    return CommissioningRecord(now=now, watchdog=watchdog, differing=found.differences)
