"""Backup and restore for callers that block and callers that await."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.bus import carry_out, carry_out_async
from drivecomm.commissioning.exploring import Forgetful as RemembersNothing, unseen
from drivecomm.commissioning.parameter_sets.everything import reading_everything, way_through
from drivecomm.commissioning.parameter_sets.journal import Forgetful
from drivecomm.commissioning.parameter_sets.parameter_set import SETTINGS, WRITABLE
from drivecomm.commissioning.parameter_sets.planning import planning
from drivecomm.commissioning.parameter_sets.reading_out import factory_values, no_progress, reading_out, subject
from drivecomm.commissioning.parameter_sets.restore_plan import RestoreOptions
from drivecomm.commissioning.parameter_sets.restoring import restoring

if TYPE_CHECKING:
    from collections.abc import Collection

    from drivecomm.bus import AsyncDrive, Drive
    from drivecomm.commissioning import exploring
    from drivecomm.commissioning.parameter_sets.journal import Remembers
    from drivecomm.commissioning.parameter_sets.parameter_set import ParameterSet, Part
    from drivecomm.commissioning.parameter_sets.reading_out import Progress
    from drivecomm.commissioning.parameter_sets.restore_plan import Plan
    from drivecomm.commissioning.parameter_sets.restoring import Restored


def back_up(drive: Drive, parts: Collection[Part] = WRITABLE, *, progress: Progress = no_progress) -> ParameterSet:
    """Read the parameters of a drive: all data sets and array elements of those that its model knows.

    parts: settings and communication unless told. progress: told the address, how many are done, and how many there
    are. Raises UsageError for a drive without a model, ReplyError and LinkError when drive or line are away.
    """
    return carry_out(drive, reading_out(subject(drive), parts, progress))


def back_up_everything(
    drive: Drive,
    logbook: exploring.Remembers | None = None,
    *,
    within: Collection[str] | None = None,
    progress: exploring.Progress = unseen,
) -> ParameterSet:
    """Read all that a drive holds, address by address; what its model does not know is kept as it came.

    logbook: what remembers the answers, so that a later call goes on where this one is cut off. within: of what the
    model does not know only these addresses. progress: told each answer, and how many there are. Raises NotSupported
    where the protocol does not tell which addresses there can be, UsageError for a drive without a model,
    FileFormatError for a logbook of another drive, ReplyError and LinkError when drive or line stay away.
    """
    of = subject(drive)
    return carry_out(drive, reading_everything(of, way_through(of, within), logbook or RemembersNothing(), progress))


def factory_set(drive: Drive, parts: Collection[Part] = SETTINGS, *, progress: Progress = no_progress) -> ParameterSet:
    """Read the factory values of a drive's parameters. Raises UsageError where such drives do not tell them."""
    return carry_out(drive, factory_values(subject(drive), parts, progress))


def plan_restore(
    drive: Drive, known: ParameterSet, options: RestoreOptions | None = None, *, progress: Progress = no_progress
) -> Plan:
    """Find out what a restore would write, and what not and why; writes nothing.

    Raises UsageError for a set of another drive unless that is wished, ValueRefusedError when a value does not fit.
    """
    return carry_out(drive, planning(subject(drive), known, options or RestoreOptions(), progress))


def carry_out_plan(
    drive: Drive, plan: Plan, journal: Remembers | None = None, *, progress: Progress = no_progress
) -> Restored:
    """Do what a plan says. journal: what remembers how far it came; see `new_journal` and `found_journal`.

    Raises StateError when the motor runs, before anything is written; ReplyError and LinkError when drive or line are
    away in the middle. What the drive refuses is in the result.
    """
    return carry_out(drive, restoring(plan, journal or Forgetful(), progress))


async def back_up_async(
    drive: AsyncDrive, parts: Collection[Part] = WRITABLE, *, progress: Progress = no_progress
) -> ParameterSet:
    """Read the parameters of a drive, as `back_up` does."""
    return await carry_out_async(drive, reading_out(subject(drive), parts, progress))


async def back_up_everything_async(
    drive: AsyncDrive,
    logbook: exploring.Remembers | None = None,
    *,
    within: Collection[str] | None = None,
    progress: exploring.Progress = unseen,
) -> ParameterSet:
    """Read all that a drive holds, as `back_up_everything` does."""
    of = subject(drive)
    way = way_through(of, within)
    return await carry_out_async(drive, reading_everything(of, way, logbook or RemembersNothing(), progress))


async def factory_set_async(
    drive: AsyncDrive, parts: Collection[Part] = SETTINGS, *, progress: Progress = no_progress
) -> ParameterSet:
    """Read the factory values of a drive's parameters, as `factory_set` does."""
    return await carry_out_async(drive, factory_values(subject(drive), parts, progress))


async def plan_restore_async(
    drive: AsyncDrive, known: ParameterSet, options: RestoreOptions | None = None, *, progress: Progress = no_progress
) -> Plan:
    """Find out what a restore would write, as `plan_restore` does."""
    return await carry_out_async(drive, planning(subject(drive), known, options or RestoreOptions(), progress))


async def carry_out_plan_async(
    drive: AsyncDrive, plan: Plan, journal: Remembers | None = None, *, progress: Progress = no_progress
) -> Restored:
    """Do what a plan says, as `carry_out_plan` does."""
    return await carry_out_async(drive, restoring(plan, journal or Forgetful(), progress))
