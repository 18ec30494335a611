"""Restore: write the parameters of a set to a drive in order, read each back, and repeat until all hold."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from drivecomm.bus import ask_status, read_parameter, write_parameter
from drivecomm.commissioning.parameter_sets.parameter_set import same
from drivecomm.commissioning.parameter_sets.restore_plan import Stage
from drivecomm.errors import DriveError, ReplyError, StateError, UsageError, WrongDriveError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.bus import Procedure
    from drivecomm.commissioning.parameter_sets.journal import RestoreRecord
    from drivecomm.commissioning.parameter_sets.reading_out import Progress
    from drivecomm.commissioning.parameter_sets.restore_plan import PlannedItem, RestorePlan
    from drivecomm.protocol import DriveStatus, Reading

_ROUNDS = 5
"""Limit of writes to one parameter; a chain of three limits that wait for each other needs four rounds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RestoreResult:
    """Result of a restore.

    written: the written parameters, in order, each read back. refused: why others do not hold the planned value, by
    address. unconfirmed: written, with unknown result, because the drive then used other communication settings. left:
    not written for that reason.
    """

    plan: RestorePlan
    written: tuple[str, ...]
    refused: Mapping[str, str] = field(default_factory=dict)
    unconfirmed: tuple[str, ...] = ()
    left: tuple[str, ...] = ()

    @property
    def complete(self) -> bool:
        """Whether the drive now has all planned values, and the plan missed none; see `RestorePlan.missed`."""
        return not (self.refused or self.unconfirmed or self.left or self.plan.missed)


def restoring(plan: RestorePlan, journal: RestoreRecord, progress: Progress) -> Procedure[RestoreResult]:
    """Carry out a restore plan.

    After all parameters are written, all are read once more. A value that a later write changed, or that was refused
    because of another parameter, is written again as long as that may help. Raises StateError if the motor runs, before
    anything is written; ReplyError or LinkError if the drive or the line fails in the middle.
    """
    yield from must_stand(plan.drive)
    work = _Work(plan, journal)
    due = [item for item in work.items if item.action == "write"]
    for _ in range(_ROUNDS):
        yield from work.write(due, progress)
        differing = yield from work.differing(progress)
        due = [item for item in differing if work.may_help(item)]
        if not due:
            break
    unconfirmed, left = yield from work.write_communication()
    if not (unconfirmed or left):
        journal.over()
    return RestoreResult(
        plan=plan,
        written=tuple(work.written),
        refused=work.refused,
        unconfirmed=tuple(unconfirmed),
        left=tuple(left),
    )


def must_stand(drive: str) -> Procedure[None]:
    """Raise StateError if the motor runs."""
    status: DriveStatus = yield ask_status()
    if status.running:
        raise StateError(
            f"{drive}: the motor runs, and a restore changes limits and ramps; nothing was written, stop it first"
        )


class _Work:
    """Restore in progress. refused: why parameters do not hold the planned value, as far as is known."""

    def __init__(self, plan: RestorePlan, journal: RestoreRecord) -> None:
        chosen = [item for item in plan.items if item.action != "skip"]
        self.items = [item for item in chosen if item.stage is not Stage.COMMUNICATION]
        self.written: list[str] = []
        self.refused: dict[str, str] = {}
        self._communication = [item for item in chosen if item.stage is Stage.COMMUNICATION]
        self._store = plan.store
        self._journal = journal
        self._writes = 0
        self._tried_at: dict[str, int] = {}

    def write(self, items: list[PlannedItem], progress: Progress) -> Procedure[None]:
        """Write these items and read each back."""
        for place, item in enumerate(items):
            progress(item.address, place, len(items))
            yield from self._write(item)

    def differing(self, progress: Progress) -> Procedure[list[PlannedItem]]:
        """Return the items whose value the drive does not hold now."""
        found = []
        for place, item in enumerate(self.items):
            progress(item.address, place, len(self.items))
            reason = yield from self._held(item)
            if reason:
                found.append(item)
                self.refused.setdefault(item.address, reason)
            else:
                self.refused.pop(item.address, None)
        return found

    def may_help(self, item: PlannedItem) -> bool:
        """Return whether another parameter was written since the last attempt, so that a retry may succeed."""
        return self._tried_at.get(item.address, -1) < self._writes

    def write_communication(self) -> Procedure[tuple[list[str], list[str]]]:
        """Write the communication settings; return those with unknown result, and those left out after that."""
        items = [item for item in self._communication if item.action == "write"]
        for place, item in enumerate(items):
            try:
                yield from self._write(item)
            except ReplyError:
                return [item.address], [later.address for later in items[place + 1 :]]
        return [], []

    def _write(self, item: PlannedItem) -> Procedure[None]:
        self.refused.pop(item.address, None)
        try:
            yield from self._send(item)
        except WrongDriveError:
            raise
        except (DriveError, UsageError) as error:
            self.refused[item.address] = str(error)
            self._tried_at[item.address] = self._writes
            return
        self._writes += 1
        self._tried_at[item.address] = self._writes
        reason = yield from self._held(item)
        if reason:
            self.refused[item.address] = reason
            return
        if item.address not in self.written:
            self.written.append(item.address)
        self._journal.wrote(item.address)

    def _send(self, item: PlannedItem) -> Procedure[None]:
        """Write a value; after a missing reply, read the value and write it again if the drive does not hold it."""
        try:
            yield write_parameter(item.address, item.value, store=self._store, options=item.options)
        except ReplyError:
            reading: Reading = yield read_parameter(item.address)
            if not same(item.held_by(reading), item.value):
                yield write_parameter(item.address, item.value, store=self._store, options=item.options)

    def _held(self, item: PlannedItem) -> Procedure[str]:
        """Return why the drive does not hold the planned value, empty if it does."""
        try:
            reading: Reading = yield read_parameter(item.address)
        except DriveError as error:
            return f"it cannot be read back: {error}"
        if same(item.held_by(reading), item.value):
            return ""
        return f"{item.value} {item.unit}".rstrip() + f" was written, and it is {reading}"
