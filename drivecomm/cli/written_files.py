"""The files that commands write: none replaces one that is there unless it is told to, and all is checked before.

A log goes on with the rows that it has, and a backup with the set of its drive.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from drivecomm.errors import UsageError
from drivecomm.tomlfile import must_be_writable

if TYPE_CHECKING:
    from pathlib import Path

force_option = click.option("--force", is_flag=True, help="Replace a file that is there.")


def must_be_free(path: Path | None, named_by: str, *, force: bool) -> None:
    """Raise UsageError if a file is there that is not to be replaced, FileFormatError if it could not be written.

    named_by: the option that names the file, if it is given.
    """
    if path is None:
        if force:
            raise UsageError(f"--force is for a file that {named_by} names, so that it has no effect; leave it out")
        return
    if path.is_file() and not force:
        raise UsageError(f"{path} exists already; name another file, or write --force to replace it")
    must_be_writable(path)


def must_be_new(path: Path) -> None:
    """Raise UsageError if there is a file, FileFormatError if it could not be written."""
    if path.is_file():
        raise UsageError(f"{path} exists already; name another file, or remove it")
    must_be_writable(path)
