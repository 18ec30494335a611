"""One drive of a call, on its open line: of the port that is given, or of the plant."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

from drivecomm.errors import DriveCommError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivecomm.bus import Drive
    from drivecomm.cli.line_options import LineOptions
    from drivecomm.protocol import DriveConfig


@contextmanager
def drive_named(line: LineOptions, text: str, model: str | None) -> Iterator[tuple[Drive, DriveConfig]]:
    """Look a drive up, open its line and yield it, and what it is called; errors within the block then name both."""
    reached, name = line.reaching(text)
    with opened_drive(reached, name, model) as drive:
        yield drive, name


@contextmanager
def opened_drive(line: LineOptions, name: DriveConfig, model: str | None) -> Iterator[Drive]:
    """Open the line of a drive and yield it; errors within the block then name both."""
    with line.bus() as bus, named_in_errors(name):
        yield name.with_options(**({"model": model} if model else {})).build(bus.drive)


@contextmanager
def named_in_errors(name: DriveConfig) -> Iterator[None]:
    """Let the errors of the block name a drive, as the plant calls it."""
    try:
        yield
    except DriveCommError as error:
        tell_of(error, name)
        raise


def tell_of(error: DriveCommError, name: DriveConfig) -> None:
    """Let an error name the drive that it is about, as the plant calls it."""
    error.about = name.labels
    if name.name not in str(error):
        error.args = (f"{name.name}: {error}", *error.args[1:])
