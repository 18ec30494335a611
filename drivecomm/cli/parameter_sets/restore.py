"""Command `restore`: the parameters of a file, written to a drive."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

import click

from drivecomm.cli import options
from drivecomm.cli.line_command import LineCommand
from drivecomm.cli.output import complain, emit, labels, plain, progress_bar, say
from drivecomm.cli.parameter_sets.saved import communication_option, drive_of_set, set_model_option
from drivecomm.cli.values import FILE
from drivecomm.commissioning.parameter_sets import (
    RestoreOptions,
    carry_out_plan,
    found_journal,
    journal_path,
    new_journal,
    plan_restore,
    read_set,
)
from drivecomm.errors import DriveError, LinkError, ReplyError, UsageError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from drivecomm.cli.line_options import LineArguments
    from drivecomm.commissioning.parameter_sets import PlannedItem, RestoreJournal, RestorePlan, RestoreResult
    from drivecomm.protocol import DriveConfig

INCOMPLETE = 1
"""Exit code of a completed restore that left out parameters which it should have restored."""


@click.command(cls=LineCommand)
@options.drive
@click.argument("file", type=FILE, help="A file written by backup.")
@set_model_option
@click.option("--dry-run", is_flag=True, help="Only show what would be written.")
@click.option("--only", metavar="PARAM", multiple=True, help="Only this parameter; repeatable.")
@communication_option
@click.option("--another-drive", is_flag=True, help="Accept a set from another drive, model or maker.")
@click.option("--volatile", is_flag=True, help="Write to RAM instead of EEPROM.")
@click.option("--resume", is_flag=True, help="Continue an interrupted restore.")
def restore(
    *,
    drive: str,
    file: Path,
    line: LineArguments,
    model: str | None,
    dry_run: bool,
    only: tuple[str, ...],
    communication: bool,
    another_drive: bool,
    volatile: bool,
    resume: bool,
) -> int:
    """Write the parameters in a file to a drive and read each back; equal values are not written.

    Exit code 5 when the drive refuses some, 1 when some of its own settings cannot be restored, 2 when nothing can be
    written, for example to a read-only drive.
    """
    if resume and dry_run:
        raise UsageError("--dry-run writes nothing, so --resume has no effect; leave one of them out")
    known = read_set(file)
    reached, name = line.reaching(drive)
    at = journal_path(file, str(name))
    journal = None
    if not dry_run:
        journal = (found_journal if resume else new_journal)(at, known, str(name))
    options = RestoreOptions(
        only=frozenset(only), communication=communication, another_drive=another_drive, volatile=volatile
    )
    with drive_of_set(reached, name, model, known) as one:
        with progress_bar("reading", shown=not line.json) as progress:
            plan = plan_restore(one, known, options, progress=progress)
        if journal is None:
            show_plan(plan, name, as_json=line.json)
            return INCOMPLETE if plan.missed else 0
        with _said_how_to_go_on(journal, line), progress_bar("writing", shown=not line.json) as progress:
            done = carry_out_plan(one, plan, journal, progress=progress)
    show_restored(done, name, as_json=line.json)
    return exit_code_of_restore(done)


def exit_code_of_restore(done: RestoreResult) -> int:
    """Return the exit code of a completed restore."""
    if done.refused:
        return DriveError.exit_code
    if done.unconfirmed or done.left:
        return ReplyError.exit_code
    return 0 if done.complete else INCOMPLETE


@contextmanager
def _said_how_to_go_on(journal: RestoreJournal, line: LineArguments) -> Iterator[None]:
    """Add to an interruption in the block how to resume the restore."""
    try:
        yield
    except (LinkError, ReplyError) as error:
        error.args = (f"{error}; {_how_to_go_on(journal)}", *error.args[1:])
        raise
    except KeyboardInterrupt:
        complain(_how_to_go_on(journal), as_json=line.json)
        raise


def _how_to_go_on(journal: RestoreJournal) -> str:
    if not journal.written:
        return "nothing was written"
    count = len(journal.written)
    return f"{count} parameter{'s were' if count > 1 else ' was'} written; repeat the command with --resume to continue"


def show_plan(plan: RestorePlan, drive: DriveConfig, *, as_json: bool) -> None:
    """Print the parameters that a restore would write, and those that it would leave alone."""
    if as_json:
        for item in plan.items:
            told = {**plain(item), "stage": item.stage.name.lower(), "quantity": item.name}
            emit(**{**labels(drive), **told, "name": drive.name})
        emit(**labels(drive), write=len(plan.to("write")), equal=len(plan.to("equal")), skip=len(plan.to("skip")),
             missed=len(plan.missed), stored=plan.store, remarks=list(plan.remarks))  # fmt: skip
        return
    _show_changes(plan.to("write"), drive)
    _show_skipped(plan, drive)
    counts = f"{len(plan.to('write'))} to write, {len(plan.to('equal'))} equal{_left_alone(plan)}"
    say(f"{drive.name}  {counts}; nothing was written")


def _show_changes(items: list[PlannedItem], drive: DriveConfig) -> None:
    """Print the present and the new value of each item."""
    names = [f"{item.address} {item.name}" for item in items]
    width = max(map(len, names), default=0)
    for name, item in zip(names, items, strict=True):
        before = "?" if item.current is None else item.current
        say(f"{drive.name}  {name:<{width}}  {before} -> {item.value} {item.unit}".rstrip())


def _left_alone(plan: RestorePlan) -> str:
    """Return the number of items that are not restored, as text; first those that should have been restored."""
    missed, as_meant = len(plan.missed), len(plan.to("skip")) - len(plan.missed)
    told = f", {missed} not restored" if missed else ""
    return told + (f", {as_meant} left alone" if as_meant else "")


def _show_skipped(plan: RestorePlan, drive: DriveConfig) -> None:
    for remark in plan.remarks:
        say(f"{drive.name}  {remark}")
    by_reason: dict[tuple[bool, str], list[PlannedItem]] = {}
    for item in plan.to("skip"):
        by_reason.setdefault((item.missed, item.reason), []).append(item)
    for (missed, reason), items in by_reason.items():
        names = ", ".join(f"{item.address} {item.name}".rstrip() for item in items)
        say(f"{drive.name}  {'not restored' if missed else 'left alone'}, {reason}: {names}")


def show_restored(done: RestoreResult, drive: DriveConfig, *, as_json: bool) -> None:
    """Print the result of a restore."""
    plan = done.plan
    if as_json:
        emit(**labels(drive), written=list(done.written), equal=len(plan.to("equal")), stored=plan.store,
             skipped={item.address: item.reason for item in plan.to("skip")}, refused=dict(done.refused),
             missed=[item.address for item in plan.missed], unconfirmed=list(done.unconfirmed), left=list(done.left),
             complete=done.complete)  # fmt: skip
        return
    planned = {item.address: item for item in plan.items}
    _show_changes([planned[address] for address in done.written], drive)
    _show_skipped(plan, drive)
    for address, reason in done.refused.items():
        say(f"{drive.name}  {address} does not hold the restored value: {reason}")
    if done.unconfirmed:
        names = ", ".join(done.unconfirmed)
        left = f", and {', '.join(done.left)} not written" if done.left else ""
        say(f"{drive.name}  {names} written{left}: it no longer answers at its old settings; use the new and --resume")
    kept = "and stored" if plan.store else "without a storage request"
    refused = f", {len(done.refused)} refused by the drive" if done.refused else ""
    equal = f"{len(plan.to('equal'))} equal before"
    say(f"{drive.name}  {len(done.written)} written {kept}, {equal}{refused}{_left_alone(plan)}")
