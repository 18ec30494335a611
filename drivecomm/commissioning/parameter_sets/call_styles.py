"""Backup and restore for blocking callers and for asyncio callers."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.bus import carry_out, carry_out_async
from drivecomm.commissioning.exploring import NoAnswerRecord as RemembersNothing, unseen
from drivecomm.commissioning.parameter_sets.everything import backup_plan, reading_everything
from drivecomm.commissioning.parameter_sets.journal import NoRestoreRecord
from drivecomm.commissioning.parameter_sets.parameter_set import SETTINGS, WRITABLE
from drivecomm.commissioning.parameter_sets.planning import planning
from drivecomm.commissioning.parameter_sets.reading_out import factory_values, no_progress, reading_out, subject
from drivecomm.commissioning.parameter_sets.restore_plan import RestoreOptions
from drivecomm.commissioning.parameter_sets.restoring import restoring

if TYPE_CHECKING:
    from collections.abc import Collection

    from drivecomm.bus import AsyncDrive, Drive
    from drivecomm.commissioning import exploring
    from drivecomm.commissioning.parameter_sets.journal import RestoreRecord
    from drivecomm.commissioning.parameter_sets.parameter_set import ParameterSet, Part
    from drivecomm.commissioning.parameter_sets.reading_out import Progress
    from drivecomm.commissioning.parameter_sets.restore_plan import RestorePlan
    from drivecomm.commissioning.parameter_sets.restoring import RestoreResult


def back_up(drive: Drive, parts: Collection[Part] = WRITABLE, *, progress: Progress = no_progress) -> ParameterSet:
    """Read the parameters of a drive: all data sets and array elements of those that its model knows.

    parts: parts of the set to read; by default settings and communication. progress: called with the address, the
    number of parameters done, and their total. Raises UsageError for a drive without a model, ReplyError or LinkError
    if the drive or the line does not respond.
    """
    return carry_out(drive, reading_out(subject(drive), parts, progress))


def back_up_everything(
    drive: Drive,
    logbook: exploring.AnswerRecord | None = None,
    *,
    within: Collection[str] | None = None,
    progress: exploring.Progress = unseen,
) -> ParameterSet:
    """Read all that a drive holds, address by address; values that its model does not know are stored as raw values.

    logbook: record of the answers, from which a later call resumes after an interruption. within: limits the addresses
    that the model does not know to these. progress: called with each step. Raises NotSupported if the protocol does not
    list the possible addresses, UsageError for a drive without a model, FileFormatError for a logbook of another drive,
    ReplyError or LinkError if the drive or the line stays silent.
    """
    of = subject(drive)
    return carry_out(drive, reading_everything(of, backup_plan(of, within), logbook or RemembersNothing(), progress))


def factory_set(drive: Drive, parts: Collection[Part] = SETTINGS, *, progress: Progress = no_progress) -> ParameterSet:
    """Read the factory values of a drive's parameters. Raises UsageError if such drives do not report them."""
    return carry_out(drive, factory_values(subject(drive), parts, progress))


def plan_restore(
    drive: Drive, known: ParameterSet, options: RestoreOptions | None = None, *, progress: Progress = no_progress
) -> RestorePlan:
    """Plan a restore: the parameters to write, and those to leave alone with the reason; writes nothing.

    Raises UsageError for a set of another drive unless the options allow it, ValueRefusedError if a value does not fit.
    """
    return carry_out(drive, planning(subject(drive), known, options or RestoreOptions(), progress))


def carry_out_plan(
    drive: Drive, plan: RestorePlan, journal: RestoreRecord | None = None, *, progress: Progress = no_progress
) -> RestoreResult:
    """Carry out a restore plan. journal: record of the progress; see `new_journal` and `found_journal`.

    Raises StateError if the motor runs, before anything is written; ReplyError or LinkError if the drive or the line
    fails in the middle. The result lists the values that the drive refused.
    """
    return carry_out(drive, restoring(plan, journal or NoRestoreRecord(), progress))


async def back_up_async(
    drive: AsyncDrive, parts: Collection[Part] = WRITABLE, *, progress: Progress = no_progress
) -> ParameterSet:
    """Read the parameters of a drive; see `back_up`."""
    return await carry_out_async(drive, reading_out(subject(drive), parts, progress))


async def back_up_everything_async(
    drive: AsyncDrive,
    logbook: exploring.AnswerRecord | None = None,
    *,
    within: Collection[str] | None = None,
    progress: exploring.Progress = unseen,
) -> ParameterSet:
    """Read all that a drive holds; see `back_up_everything`."""
    of = subject(drive)
    way = backup_plan(of, within)
    return await carry_out_async(drive, reading_everything(of, way, logbook or RemembersNothing(), progress))


async def factory_set_async(
    drive: AsyncDrive, parts: Collection[Part] = SETTINGS, *, progress: Progress = no_progress
) -> ParameterSet:
    """Read the factory values of a drive's parameters; see `factory_set`."""
    return await carry_out_async(drive, factory_values(subject(drive), parts, progress))


async def plan_restore_async(
    drive: AsyncDrive, known: ParameterSet, options: RestoreOptions | None = None, *, progress: Progress = no_progress
) -> RestorePlan:
    """Plan a restore; see `plan_restore`."""
    return await carry_out_async(drive, planning(subject(drive), known, options or RestoreOptions(), progress))


async def carry_out_plan_async(
    drive: AsyncDrive, plan: RestorePlan, journal: RestoreRecord | None = None, *, progress: Progress = no_progress
) -> RestoreResult:
    """Carry out a restore plan; see `carry_out_plan`."""
    return await carry_out_async(drive, restoring(plan, journal or NoRestoreRecord(), progress))
