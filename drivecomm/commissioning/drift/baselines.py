"""Baselines: the approved set of each drive, as a file in the folder `baselines` beside the plant file."""

from __future__ import annotations

import shlex
from dataclasses import replace
from typing import TYPE_CHECKING

from drivecomm.commissioning.parameter_sets import WRITABLE, file_stem, read_set, text_of
from drivecomm.errors import FileFormatError, UsageError
from drivecomm.tomlfile import write_atomically

if TYPE_CHECKING:
    from pathlib import Path

    from drivecomm.commissioning.parameter_sets import Approval, ParameterSet
    from drivecomm.protocol import DriveConfig

FOLDER = "baselines"


def baseline_path(plant_file: Path, drive: str) -> Path:
    """Return the path of the baseline of a drive of this plant; each drive has a file of its own."""
    return plant_file.parent / FOLDER / f"{file_stem(drive)}.toml"


def approved_set(known: ParameterSet, approval: Approval) -> ParameterSet:
    """Return the part of a set that can be approved: settings and communication, without displayed or unknown values.

    Raises UsageError if that part is empty, because every state of the drive would then count as approved.
    """
    kept = {entry.address: entry for entry in known.of(WRITABLE)}
    if not kept:
        raise UsageError(f"no setting of {known.drive} was read, so there is nothing to approve")
    return replace(known, entries=kept, explored=None, approved=approval)


def read_baseline(path: Path) -> ParameterSet:
    """Read a baseline. Raises FileFormatError as `read_set` does, and for a set without approval."""
    known = read_set(path)
    if known.approved is None:
        raise FileFormatError(
            f"{path}: this parameter set is not approved: it has no [approved]; approve it with drivecomm baseline "
            "accept and --from, or remove it"
        )
    return known


def write_baseline(path: Path, known: ParameterSet) -> None:
    """Replace the drive's approved set in its file, atomically.

    Raises FileFormatError if the file cannot be written.
    """
    try:
        path.parent.mkdir(exist_ok=True)
    except OSError as error:
        raise FileFormatError(f"{path.parent}: this folder cannot be made: {error.strerror or error}") from error
    write_atomically(path, text_of(known))


def restore_command(drive: DriveConfig, baseline: Path, plant: Path | None = None) -> str:
    """Return the command that writes the approved set of a drive to its replacement.

    plant: the plant file; None for the one that the command line finds by itself.
    """
    named = ["--plant", str(plant)] if plant else []
    arm = [] if drive.armed else ["--arm"]
    return shlex.join(["drivecomm", "restore", drive.name, str(baseline), "--another-drive", *arm, *named])
