"""Output files of commands: never overwritten without --force, and checked before the work begins.

A log continues after its existing rows, and a backup replaces an older set of its drive.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from drivecomm.errors import UsageError
from drivecomm.tomlfile import must_be_writable

if TYPE_CHECKING:
    from pathlib import Path

force_option = click.option("--force", is_flag=True, help="Replace an existing file.")


def must_be_free(path: Path | None, named_by: str, *, force: bool) -> None:
    """Raise UsageError if an existing file must not be replaced, FileFormatError if the path is not writable.

    named_by: option that names the file, for the error message.
    """
    if path is None:
        if force:
            raise UsageError(f"--force has no effect without {named_by}; leave it out")
        return
    if path.is_file() and not force:
        raise UsageError(f"{path} exists already; name another file, or write --force to replace it")
    must_be_writable(path)


def must_be_new(path: Path) -> None:
    """Raise UsageError if the file exists, FileFormatError if the path is not writable."""
    if path.is_file():
        raise UsageError(f"{path} exists already; name another file, or remove it")
    must_be_writable(path)
