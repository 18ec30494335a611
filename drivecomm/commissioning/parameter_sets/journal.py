"""Journal of a restore: the parameters written so far, in a file beside the set, to resume after an interruption.

The file is JSON Lines: a head with the set and the drive, then a line for each parameter that was written and read
back. A line that was cut off, such as by a power failure, counts as not written.
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


class RestoreRecord(Protocol):
    """Interface of a record of the progress of a restore."""

    def wrote(self, address: str) -> None:
        """Record that a parameter was written and read back."""
        ...

    def over(self) -> None:
        """Record that the restore is complete."""
        ...


class NoRestoreRecord:
    """Record that keeps nothing: an interrupted restore leaves no trace of its progress."""

    def wrote(self, address: str) -> None:
        """Ignore the address."""

    def over(self) -> None:
        """Do nothing."""


class RestoreJournal:
    """Journal of a restore in a file, which is created with the first write and removed when the restore is complete.

    written: the written parameters, including those of an earlier restore that was interrupted. Their values are read
    again: a journal shows that a drive was left half done, and never which values a drive holds.
    """

    def __init__(self, path: Path, known: ParameterSet, drive: str, written: frozenset[str] = frozenset()) -> None:
        self.path = path
        self.written = written
        self._head = _head(known, drive)

    def wrote(self, address: str) -> None:
        """Append a line and sync it to the disk before the next parameter is written. Raises UsageError on failure."""
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
        """Remove the journal file."""
        self.path.unlink(missing_ok=True)


def journal_path(of: Path, drive: str) -> Path:
    """Return the path of the journal for a set and a drive: beside the set, as `pump.toml.vabus-1.journal`."""
    return of.with_name(f"{of.name}.{drive.replace(':', '-')}.journal")


def new_journal(path: Path, known: ParameterSet, drive: str) -> RestoreJournal:
    """Return a journal for a new restore. Raises UsageError if an earlier restore was interrupted."""
    if path.exists():
        raise UsageError(
            f"{path}: an earlier restore to {drive} was interrupted; continue it (--resume), or remove this file "
            "to begin again"
        )
    return RestoreJournal(path, known, drive)


def found_journal(path: Path, known: ParameterSet, drive: str) -> RestoreJournal:
    """Return the journal of an interrupted restore, an empty one if it was interrupted before its first write.

    Raises FileFormatError for a file that is not a journal of this restore.
    """
    if not path.exists():
        return RestoreJournal(path, known, drive)
    try:
        data = path.read_bytes()
        whole = data[: data.rfind(b"\n") + 1]
        head, *rest = [json.loads(line) for line in whole.decode("utf-8").splitlines()] or [_head(known, drive)]
        written = frozenset(str(line["wrote"]) for line in rest)
        if whole != data:
            # New lines must not be appended to a line that was cut off.
            path.write_bytes(whole)
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise FileFormatError(f"{path}: this is not a journal of a restore; remove it to begin again") from error
    if head != _head(known, drive):
        raise FileFormatError(
            f"{path}: this journal is of another parameter set or drive, or the set was changed since; remove it to "
            "begin again"
        )
    return RestoreJournal(path, known, drive, written)


def _head(known: ParameterSet, drive: str) -> dict[str, str]:
    return {"restores": _digest(known), "to": drive}


def _digest(known: ParameterSet) -> str:
    text = "\n".join([known.protocol, known.drive, known.model, *(entries_text(known, part) for part in PARTS)])
    return hashlib.sha256(text.encode()).hexdigest()
