"""Commands `baseline accept` and `baseline show`: the approved parameters of the drives of a plant."""

from __future__ import annotations

import getpass
import shlex
from dataclasses import fields
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import click

from drivecomm.cli import options
from drivecomm.cli.commands import CliCommand
from drivecomm.cli.drive_names import known_plant
from drivecomm.cli.line_command import LineCommand
from drivecomm.cli.output import complain, emit, labels, print_columns, progress_bar, say, tell
from drivecomm.cli.parameter_sets.saved import drive_of_set, entry_content, entry_text, parameter_label
from drivecomm.cli.values import FILE
from drivecomm.commissioning.drift import (
    approved_set,
    baseline_path,
    drift_between,
    read_baseline,
    write_baseline,
)
from drivecomm.commissioning.parameter_sets import Approval, back_up, read_set
from drivecomm.errors import DriveCommError, UsageError
from drivecomm.tomlfile import must_be_writable

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from drivecomm.cli.line_options import LineArguments
    from drivecomm.commissioning.drift import Drift
    from drivecomm.commissioning.parameter_sets import Difference, ParameterSet
    from drivecomm.plant import Plant
    from drivecomm.protocol import DriveConfig


@click.command(cls=LineCommand)
@options.drive
@click.option("--by", metavar="WHO", help="Who approves it. Default: the user of this system.")
@click.option("--why", metavar="TEXT", default="", help="Why it is approved.")
@click.option("--from", "source", type=FILE, help="A file written by backup, instead of reading the drive.")
def accept(*, drive: str, line: LineArguments, by: str | None, why: str, source: Path | None) -> int:
    """Make the present parameters of a drive, or a file, its approved set.

    The set replaces an older one in the folder baselines beside the plant file; the changes are listed.
    """
    place = line.in_plant(drive)
    if place is None:
        raise UsageError(
            f"{drive} is not in a plant, and baselines are stored beside a plant file; name the plant with --plant"
        )
    reached, name = line.reaching(drive)
    path = baseline_path(Path(place[0]), name.name)
    must_be_writable(path if path.parent.exists() else path.parent)
    before = read_set(path) if path.exists() else None
    approval = Approval(
        by=by or system_user("name the approver with --by"), why=why, time=datetime.now(UTC).replace(microsecond=0)
    )
    if source is None:
        with drive_of_set(reached, name, None, before) as one, progress_bar("reading", shown=not line.json) as progress:
            found = back_up(one, progress=progress)
    else:
        known = (each.name for each in fields(line) if each.name not in ("json", "plant"))
        line.refuse("the set is read from a file and not from a drive", *known)
        found = read_set(source)
        if found.drive != str(name):
            raise UsageError(f"{source}: this is the parameter set of {found.drive}, and {name.name} is {name}")
    approved = approved_set(found, approval)
    write_baseline(path, approved)
    _show_accepted(approved, before, path, name, as_json=line.json)
    return 0


def system_user(remedy: str) -> str:
    """Return the user name of this process. Raises UsageError with this remedy if the system does not report it."""
    try:
        return getpass.getuser()
    except (OSError, KeyError, ImportError) as error:
        raise UsageError(f"this system does not report your user name; {remedy}") from error


def _show_accepted(
    approved: ParameterSet, before: ParameterSet | None, path: Path, name: DriveConfig, *, as_json: bool
) -> None:
    change = None if before is None else drift_between(before, approved)
    if as_json:
        emit_differences(name, change.changed if change else ())
        emit(**labels(name), file=str(path), parameters=len(approved.entries), not_read=dict(approved.not_read),
             by=approved.approved and approved.approved.by, replaces=before is not None,
             changed=len(change.changed) if change else 0, other_drive=change.replaced if change else "")  # fmt: skip
        return
    if change is not None:
        if change.replaced:
            say(f"{name.name}  the previous set was of another drive: {change.replaced}")
        show_changes(name, change)
    for address, reason in approved.not_read.items():
        say(f"{name.name}  {address}  not read, so not approved: {reason}")
    say(f"{name.name}  {len(approved.entries)} parameters approved, in {path}")


def emit_differences(name: DriveConfig, differences: Sequence[Difference]) -> None:
    """Print an object for each parameter that differs from the approved one."""
    for each in differences:
        kind = "changed" if each.kind == "value" else each.kind
        emit(**labels(name), kind=kind, parameter=each.address, quantity=each.name, approved=entry_content(each.left),
             now=entry_content(each.right), reason=each.reason)  # fmt: skip


def show_changes(name: DriveConfig, found: Drift) -> None:
    """Print each value that changed, with its approved and its present value."""
    width = max((len(parameter_label(each)) for each in found.changed), default=0)
    for each in found.changed:
        say(f"{name.name}  {parameter_label(each):<{width}}  {entry_text(each.left)} -> {entry_text(each.right)}")


def plant_of_baselines(file: Path | None) -> Plant:
    """Return the plant of a call. Raises UsageError if there is no plant file."""
    known = known_plant(file, port_given=False)
    if known is None:
        raise UsageError("no plant given, and baselines are stored beside a plant file; name one with --plant")
    return known


def report_missing_baselines(names: Collection[str], *, as_json: bool) -> None:
    """Print the drives without a baseline, and the command that makes one."""
    if names:
        command = f"drivecomm baseline accept {shlex.quote(next(iter(names)))}"
        text = f"without a baseline: {', '.join(names)}; make one: {command}"
        tell(text, as_json=as_json, without_baseline=list(names), command=command)


@click.command(cls=CliCommand)
@click.argument(
    "drive", required=False, shell_complete=options.complete_drive_or_group, help="Or a group. Default: all."
)
@click.option("--plant", type=FILE, help="Plant file. Default: $DRIVECOMM_PLANT or plant.toml here.")
@options.json
def show(*, drive: str | None, plant: Path | None, json: bool) -> int:
    """Show which drives have an approved set: by whom, when and why. No line is opened."""
    known = plant_of_baselines(plant)
    code, rows, lacking = 0, [], []
    for each in known.drives if drive is None else known.named(drive):
        path = baseline_path(Path(known.file), each.name)
        if not path.exists():
            lacking.append(each.name)
            continue
        try:
            found = read_baseline(path)
        except DriveCommError as error:
            error.about = labels(each)
            complain(error, as_json=json)
            code = max(code, error.exit_code)
            continue
        if (approval := found.approved) is not None:
            if json:
                emit(**labels(each), file=str(path), parameters=len(found.entries), by=approval.by, why=approval.why,
                     time=approval.time.isoformat())  # fmt: skip
            when = approval.time.strftime("%Y-%m-%d %H:%M UTC")
            rows.append((each.name, f"{len(found.entries)} parameters", approval.by, when, approval.why))
    if rows and not json:
        print_columns(rows)
    report_missing_baselines(lacking, as_json=json)
    return max(code, UsageError.exit_code) if drive is not None and lacking else code
