"""What a restore has written so far, in a file beside the parameter set, so that one that was cut off can go on.

JSON Lines: what is restored to which drive, then a line for each parameter that was written and read back. A line that
was cut in the middle, by a power failure say, counts as not written.
"""

from __future__ import annotations

import hashlib
import json
import os
from typing import TYPE_CHECKING, Protocol

from drivecomm.commissioning.parameter_sets.files import entries_text
from drivecomm.commissioning.parameter_sets.parameter_set import PARTS
from drivecomm.errors import FileFormatError, UsageError

if TYPE_CHECKING:
    from pathlib import Path

    from drivecomm.commissioning.parameter_sets.parameter_set import ParameterSet


class Remembers(Protocol):
    """What a restore tells what it has done."""

    def wrote(self, address: str) -> None:
        """Remember that a parameter was written and read back."""
        ...

    def over(self) -> None:
        """Remember that the restore came to its end."""
        ...


class Forgetful:
    """Remembers nothing: a restore that is cut off leaves no trace of how far it came."""

    def wrote(self, address: str) -> None:
        """Forget it."""

    def over(self) -> None:
        """Forget it."""


class Journal:
    """A restore's journal as a file. The file is made with the first write and removed when the restore is over.

    written: the parameters that were written, by an earlier restore that was cut off too. Whether they still hold is
    read again: a journal says that a drive was left half done, and never what a drive holds.
    """

    def __init__(self, path: Path, known: ParameterSet, drive: str, written: frozenset[str] = frozenset()) -> None:
        self.path = path
        self.written = written
        self._head = _head(known, drive)

    def wrote(self, address: str) -> None:
        """Write a line, and have it on the disk before the next parameter is written."""
        try:
            with self.path.open("a", encoding="utf-8") as file:
                if not file.tell():
                    file.write(json.dumps(self._head) + "\n")
                file.write(json.dumps({"wrote": address}) + "\n")
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise UsageError(f"{self.path}: the journal cannot be written: {error.strerror or error}") from error
        self.written |= {address}

    def over(self) -> None:
        """Remove the file."""
        self.path.unlink(missing_ok=True)


def journal_path(of: Path, drive: str) -> Path:
    """Return where the journal of restoring this file to this drive is: beside it, `pump.toml.vabus-1.journal`."""
    return of.with_name(f"{of.name}.{drive.replace(':', '-')}.journal")


def new_journal(path: Path, known: ParameterSet, drive: str) -> Journal:
    """Return a journal for a restore that begins. Raises UsageError when an earlier one was cut off."""
    if path.exists():
        raise UsageError(
            f"{path}: an earlier restore to {drive} was cut off; go on with it (--resume), or remove this file to "
            "begin again"
        )
    return Journal(path, known, drive)


def found_journal(path: Path, known: ParameterSet, drive: str) -> Journal:
    """Return the journal of a restore that was cut off, an empty one where it was before its first write.

    Raises FileFormatError for a file that is no journal of this restore.
    """
    if not path.exists():
        return Journal(path, known, drive)
    try:
        data = path.read_bytes()
        whole = data[: data.rfind(b"\n") + 1]
        head, *rest = [json.loads(line) for line in whole.decode("utf-8").splitlines()] or [_head(known, drive)]
        written = frozenset(str(line["wrote"]) for line in rest)
        if whole != data:
            # What is appended must not be glued to a line that was cut.
            path.write_bytes(whole)
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise FileFormatError(f"{path}: this is no journal of a restore; remove it to begin again") from error
    if head != _head(known, drive):
        raise FileFormatError(
            f"{path}: this journal is of another parameter set or drive, or the set was changed since; remove it to "
            "begin again"
        )
    return Journal(path, known, drive, written)


def _head(known: ParameterSet, drive: str) -> dict[str, str]:
    return {"restores": _digest(known), "to": drive}


def _digest(known: ParameterSet) -> str:
    text = "\n".join([known.protocol, known.drive, known.model, *(entries_text(known, part) for part in PARTS)])
    return hashlib.sha256(text.encode()).hexdigest()
