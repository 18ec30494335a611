"""One drive of a call, on its open line: of the port that is given, or of the plant."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

from drivecomm.errors import DriveCommError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivecomm.cli.drive_names import DriveName
    from drivecomm.cli.line_options import LineOptions
    from drivecomm.drive import Drive


@contextmanager
def drive_named(line: LineOptions, text: str, model: str | None) -> Iterator[Drive]:
    """Look a drive up, open its line and yield it; errors within the block then name both."""
    reached, name = line.reaching(text)
    with opened_drive(reached, name, model) as drive:
        yield drive


@contextmanager
def opened_drive(line: LineOptions, name: DriveName, model: str | None) -> Iterator[Drive]:
    """Open the line of a drive and yield it; errors within the block then name both."""
    with line.bus() as bus:
        drive = bus.drive(name.protocol, name.address, **{**name.options, **({"model": model} if model else {})})
        with named_in_errors(drive):
            yield drive


@contextmanager
def named_in_errors(drive: Drive) -> Iterator[None]:
    """Name a drive in the errors of the block."""
    try:
        yield
    except DriveCommError as error:
        if drive.name not in str(error):
            error.args = (f"{drive.name}: {error}", *error.args[1:])
        raise
