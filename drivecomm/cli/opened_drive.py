"""One drive of a call, on its open line: of the port that is given, or of the plant."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

from drivecomm.errors import DriveCommError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivecomm.bus import Drive
    from drivecomm.cli.drive_names import DriveName
    from drivecomm.cli.line_options import LineOptions


@contextmanager
def drive_named(line: LineOptions, text: str, model: str | None) -> Iterator[tuple[Drive, DriveName]]:
    """Look a drive up, open its line and yield it, and what it is called; errors within the block then name both."""
    reached, name = line.reaching(text)
    with opened_drive(reached, name, model) as drive:
        yield drive, name


@contextmanager
def opened_drive(line: LineOptions, name: DriveName, model: str | None) -> Iterator[Drive]:
    """Open the line of a drive and yield it; errors within the block then name both."""
    with line.bus() as bus, named_in_errors(name):
        yield bus.drive(name.protocol, name.address, **{**name.options, **({"model": model} if model else {})})


@contextmanager
def named_in_errors(name: DriveName) -> Iterator[None]:
    """Let the errors of the block name a drive, as the plant calls it."""
    try:
        yield
    except DriveCommError as error:
        tell_of(error, name)
        raise


def tell_of(error: DriveCommError, name: DriveName) -> None:
    """Let an error name the drive that it is about, as the plant calls it."""
    error.about = name.keys
    if name.name not in str(error):
        error.args = (f"{name.name}: {error}", *error.args[1:])
