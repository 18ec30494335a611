"""Command `drift`: differences between the drives of a plant and their approved sets."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from drivecomm.cli import options
from drivecomm.cli.baseline import emit_differences, plant_of_baselines, report_missing_baselines, show_changes
from drivecomm.cli.line_command import LineCommand
from drivecomm.cli.output import complain, emit, labels, progress_bar, say
from drivecomm.cli.parameter_sets.saved import drive_of_set, parameter_label
from drivecomm.commissioning.drift import baseline_path, read_baseline, read_drift, restore_command
from drivecomm.errors import DriveCommError, UsageError

if TYPE_CHECKING:
    from drivecomm.cli.line_options import LineArguments
    from drivecomm.commissioning.drift import Drift
    from drivecomm.protocol import DriveConfig


@click.command(cls=LineCommand)
@click.argument(
    "drives",
    metavar="[DRIVE...]",
    nargs=-1,
    shell_complete=options.complete_drive_or_group,
    help="Drives or groups. Default: all of the plant.",
)
def drift(*, drives: tuple[str, ...], line: LineArguments) -> int:
    """List the differences between the drives of a plant and their approved sets.

    Displayed values and commands never count. If one drive cannot be read, the others still are. Exit code 1 if there
    are differences.
    """
    plant = plant_of_baselines(line.plant)
    # All drives are checked before the first one is read, because reading is slow.
    asked = line.reaching_each(drives or [each.name for each in plant.drives])
    known = {(each.line, str(each)) for each in plant.drives}
    if outside := [name.name for _, name in asked if (name.line, str(name)) not in known]:
        raise UsageError(f"{outside[0]} is not in a plant, so it has no baseline; name its plant with --plant")
    paths = {name.name: baseline_path(Path(plant.file), name.name) for _, name in asked}
    lacking = [name for name, path in paths.items() if not path.exists()]
    code = 0
    for reached, name in asked:
        if name.name in lacking:
            continue
        try:
            found = _drift_of(reached, name, paths[name.name], as_json=line.json)
        except DriveCommError as error:
            error.about = labels(name)
            complain(error, as_json=line.json, where=name.name)
            code = max(code, error.exit_code)
        else:
            _show(found, name, restore_command(name, paths[name.name], line.plant), as_json=line.json)
            code = max(code, 0 if found.same else 1)
    report_missing_baselines(lacking, as_json=line.json)
    # A requested comparison that could not be made must not end with success.
    return max(code, UsageError.exit_code) if lacking and (drives or len(lacking) == len(asked)) else code


def _drift_of(reached: LineArguments, name: DriveConfig, path: Path, *, as_json: bool) -> Drift:
    approved = read_baseline(path)
    with (
        drive_of_set(reached, name, None, approved) as one,
        progress_bar(f"reading {name.name}", shown=not as_json) as progress,
    ):
        return read_drift(one, approved, progress=progress)


def _show(found: Drift, name: DriveConfig, restoring: str, *, as_json: bool) -> None:
    approval = found.approved.approved
    if as_json:
        if not found.replaced:
            emit_differences(name, (*found.changed, *found.not_comparable))
        emit(**labels(name), kind="drive", same=found.same, replaced=found.replaced,
             restore=restoring if found.replaced else "", changed=len(found.changed),
             not_comparable=len(found.not_comparable), untold=list(found.untold), equal=found.equal,
             never_read=list(found.never_read), in_ram=list(found.in_ram), unapproved=list(found.unapproved),
             firmware=[found.approved.firmware, found.now.firmware], by=approval and approval.by,
             time=approval and approval.time.isoformat())  # fmt: skip
        return
    if found.replaced:
        differ = f"{len(found.changed)} of its settings differ, {found.equal} are equal"
        say(f"{name.name}  replaced, the approved set is of another drive: {found.replaced}; {differ}")
        say(f"{name.name}  to give it the approved set: {restoring}")
        return
    show_changes(name, found)
    by_reason: dict[str, list[str]] = {}
    for each in found.not_comparable:
        by_reason.setdefault(each.reason, []).append(parameter_label(each))
    by_reason["not read then or now"] = list(found.never_read)
    for reason, names in by_reason.items():
        if names:
            say(f"{name.name}  not comparable, {reason}: {', '.join(names)}")
    if found.untold:
        say(f"{name.name}  it may be another drive, because it does not report its {', '.join(found.untold)}")
    for what, addresses in (("written to RAM only", found.in_ram), ("not in the approved set", found.unapproved)):
        if addresses:
            say(f"{name.name}  {what}: {', '.join(addresses)}")
    if found.approved.firmware != found.now.firmware:
        say(f"{name.name}  firmware {found.approved.firmware or '-'} -> {found.now.firmware or '-'}")
    apart = f", {len(found.not_comparable)} not comparable" if found.not_comparable else ""
    by = "" if approval is None else f" by {approval.by} on {approval.time:%Y-%m-%d}"
    say(f"{name.name}  {len(found.changed)} changed{apart}, {found.equal} as approved{by}")
