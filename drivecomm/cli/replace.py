"""Command `replace`: the approved settings of a drive, restored to its replacement."""

from __future__ import annotations

import dataclasses
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from drivecomm.cli import options
from drivecomm.cli.baseline import show_changes
from drivecomm.cli.line_command import LineCommand
from drivecomm.cli.models.setup import filled_sheet, show_sheet
from drivecomm.cli.output import counted, emit, labels, progress_bar, say, tell
from drivecomm.cli.parameter_sets.restore import exit_code_of_restore, show_plan, show_restored
from drivecomm.cli.parameter_sets.saved import drive_of_set
from drivecomm.cli.values import FILE
from drivecomm.commissioning import check_replacement
from drivecomm.commissioning.drift import baseline_path, read_baseline, read_drift, restore_command
from drivecomm.commissioning.parameter_sets import (
    RestoreOptions,
    carry_out_plan,
    found_journal,
    journal_path,
    plan_restore,
    read_set,
)
from drivecomm.errors import NoReplyError, UsageError

if TYPE_CHECKING:
    from drivecomm.bus import Drive
    from drivecomm.cli.line_options import LineArguments
    from drivecomm.commissioning import Replacement
    from drivecomm.commissioning.drift import Drift
    from drivecomm.commissioning.parameter_sets import ParameterSet, RestorePlan
    from drivecomm.protocol import DriveConfig


@click.command(cls=LineCommand)
@options.drive
@click.argument("file", type=FILE, required=False, help="A file written by backup. Default: the drive's baseline.")
@click.option("--plate-compared", is_flag=True, help="You compared the name plates: type and size are the same.")
@click.option("--yes", is_flag=True, help="Write without asking.")
def replace(*, drive: str, file: Path | None, line: LineArguments, plate_compared: bool, yes: bool) -> int:
    """Restore the approved settings of a drive to its replacement, then compare.

    While the new drive does not answer, shows the settings to make at its panel. A drive of another type or size gets
    nothing. The watchdog is restored last. Run the command again after an interruption: it continues.
    """
    reached, name = line.reaching(drive)
    path = file or _baseline(drive, name, line)
    approved = read_baseline(path) if file is None else read_set(path)
    if approved.drive != str(name):
        raise UsageError(f"{path}: this is the parameter set of {approved.drive}, and {name.name} is {name}")
    with drive_of_set(reached, name, None, approved) as one:
        try:
            found = check_replacement(one, approved)
            one.status()
        except NoReplyError as error:
            show_sheet(filled_sheet(None if "model" in name.options else approved.model, name), as_json=line.json)
            scan = shlex.join(["drivecomm", "scan", str(reached.port), "--protocol", name.protocol, "--wide"])
            how = "set the new drive up at its panel as listed, and run this again; to find one that has other settings"
            error.args = (f"{error}; {how}: {scan}", *error.args[1:])
            raise
        _must_be_replacement(found, name, path, line.plant, plate_compared=plate_compared)
        for key, before, after in found.serials:
            tell(f"{name.name}  {key}  {before} -> {after}", as_json=line.json, **labels(name), kind="identity",
                 key=key, approved=before, now=after)  # fmt: skip
        return _NewDrive(drive=one, approved=approved, path=path, name=name, line=line).restore(yes=yes)


def _baseline(drive: str, name: DriveConfig, line: LineArguments) -> Path:
    """Return the file of the drive's baseline. Raises UsageError if there is none."""
    place = line.in_plant(drive)
    if place is None:
        raise UsageError(f"{drive} is not in a plant, so it has no baseline; name a file that drivecomm backup wrote")
    path = baseline_path(Path(place[0]), name.name)
    if not path.exists():
        raise UsageError(f"{name.name} has no baseline; name a file that drivecomm backup wrote")
    return path


def _must_be_replacement(
    found: Replacement, name: DriveConfig, path: Path, plant: Path | None, *, plate_compared: bool
) -> None:
    """Raise UsageError unless the drive is another one of the same type and size."""
    if found.differs:
        raise UsageError(
            f"{name.name} is now a drive of another type or size: {'; '.join(found.differs)}; nothing was written; if "
            f"that is intended, check each value before you write it: {restore_command(name, path, plant)} --dry-run"
        )
    if found.unchanged:
        raise UsageError(
            f"{name.name} is still the drive whose settings were approved (serial number {found.unchanged}), so there "
            f"is nothing to replace; drivecomm drift {shlex.quote(name.name)} shows what changed in it"
        )
    if found.needs_name_plate and not plate_compared:
        what = f"its {', '.join(found.not_told)}" if found.not_told else "its type and size"
        raise UsageError(
            f"{name.name} does not report {what}, so a wrong drive would not be noticed; nothing was written; compare "
            "its name plate with the old one, and confirm with --plate-compared"
        )


def _agreed(plan: RestorePlan, name: DriveConfig, *, as_json: bool) -> bool:
    """Ask the user whether to write; False without a terminal."""
    if as_json or not sys.stdin.isatty():
        return False
    show_plan(plan, name, as_json=False)
    return click.confirm(f"Write {counted(len(plan.to('write')), 'parameter')} to {name.name}?", err=True)


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class _NewDrive:
    """Drive that gets an approved set. path: file of the set."""

    drive: Drive
    approved: ParameterSet
    path: Path
    name: DriveConfig
    line: LineArguments

    def restore(self, *, yes: bool) -> int:
        """Restore all settings, the watchdog last, and compare. Returns the exit code."""
        as_json = self.line.json
        watchdog = self._watchdog()
        with progress_bar("reading", shown=not as_json) as progress:
            plan = plan_restore(self.drive, self.approved, RestoreOptions(another_drive=True), progress=progress)
        plan = dataclasses.replace(plan, items=tuple(item for item in plan.items if item.address not in watchdog))
        if not (yes or _agreed(plan, self.name, as_json=as_json)):
            if as_json or not sys.stdin.isatty():
                show_plan(plan, self.name, as_json=as_json)
            text = f"{self.name.name}  nothing was written; --yes writes it"
            tell(text, as_json=as_json, **labels(self.name), written=[])
            return 1
        codes = [self._carry_out(plan)]
        if watchdog:
            # An active watchdog would trip the drive between two slow writes.
            only = RestoreOptions(only=watchdog, another_drive=True, communication=True)
            codes.append(
                self._carry_out(dataclasses.replace(plan_restore(self.drive, self.approved, only), remarks=()))
            )
        with progress_bar("comparing", shown=not as_json) as progress:
            drift = read_drift(self.drive, self.approved, progress=progress)
        self._show(drift)
        return max(*codes, 1 if drift.changed or drift.not_comparable else 0)

    def _carry_out(self, plan: RestorePlan) -> int:
        journal = found_journal(journal_path(self.path, str(self.name)), self.approved, str(self.name))
        with progress_bar("writing", shown=not self.line.json) as progress:
            done = carry_out_plan(self.drive, plan, journal, progress=progress)
        show_restored(done, self.name, as_json=self.line.json)
        return exit_code_of_restore(done)

    def _watchdog(self) -> frozenset[str]:
        """Return the addresses of the drive's watchdog in the set, which a restore of everything leaves alone."""
        watchdog = self.drive.model.watchdog if self.drive.model else None
        if watchdog is None:
            return frozenset()
        own = (watchdog.time, watchdog.action)
        return frozenset(entry.address for entry in self.approved.entries.values() if entry.parameter in own)

    def _show(self, drift: Drift) -> None:
        """Print how the drive differs from the approved set, and the next command."""
        plant = ["--plant", str(self.line.plant)] if self.line.plant else []
        accept = shlex.join(["drivecomm", "baseline", "accept", self.name.name, *plant, "--why", "replaced"])
        if self.line.json:
            emit(**labels(self.name), kind="replaced", equal=drift.equal, changed=len(drift.changed),
                 not_comparable=len(drift.not_comparable), accept=accept)  # fmt: skip
            return
        show_changes(self.name, drift)
        apart = len(drift.changed) + len(drift.not_comparable)
        differ = f", {apart} not" if apart else ""
        equal = counted(drift.equal, "parameter")
        say(f"{self.name.name}  {equal} as approved{differ}; when the machine runs well: {accept}")
