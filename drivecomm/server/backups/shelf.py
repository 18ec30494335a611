"""Backup files: one folder a drive, one file a change, the oldest removed; each change committed if configured."""

from __future__ import annotations

import shutil
import subprocess
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Literal, TypeAlias

from drivecomm.commissioning.exploring import lasting_identity
from drivecomm.commissioning.parameter_sets import WRITABLE, compare, file_stem, read_set, write_set
from drivecomm.errors import FileFormatError, UsageError, in_one_line

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from drivecomm.commissioning.parameter_sets import Difference, ParameterSet

Extent: TypeAlias = Literal["settings", "everything"]

_GIT_S = 30.0
_NAMES = {"settings": "%Y-%m-%dT%H-%M-%SZ.toml", "everything": "%Y-%m-%dT%H-%M-%SZ.everything.toml"}
_PATTERNS = {"settings": "????-??-??T??-??-??Z.toml", "everything": "????-??-??T??-??-??Z.everything.toml"}


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredBackup:
    """The result of storing a backup.

    file: the new file, None if nothing had changed. before: the file before it. changed: parameters whose values differ
    from it. another: differences in the drive's identity or firmware, as sentences. trouble: why it could not be
    committed.
    """

    file: Path | None
    before: Path | None = None
    changed: Sequence[Difference] = ()
    another: Sequence[str] = ()
    trouble: str = ""


class Shelf:
    """The backup files of a plant. git: commit each change in the work tree that contains the folder."""

    def __init__(self, folder: Path, *, git: bool = False) -> None:
        self.folder = folder
        self._git = git

    def files(self, drive: str, extent: Extent = "settings") -> list[Path]:
        """Return the files of a drive, the oldest first."""
        return sorted((self.folder / file_stem(drive)).glob(_PATTERNS[extent]))

    def _latest(self, drive: str, extent: Extent) -> tuple[Path | None, ParameterSet | None]:
        """Return the latest readable file and its set; damaged files are skipped."""
        return next(self._readable(drive, extent), (None, None))

    def sets(self, drive: str) -> Iterator[tuple[float, ParameterSet]]:
        """Yield the settings of a drive with the times of their files, in seconds since 1970, the newest first."""
        for file, known in self._readable(drive, "settings"):
            yield time_of(file), known

    def _readable(self, drive: str, extent: Extent) -> Iterator[tuple[Path, ParameterSet]]:
        for file in reversed(self.files(drive, extent)):
            with suppress(FileFormatError):
                yield file, read_set(file)

    def keep(self, drive: str, found: ParameterSet, extent: Extent, *, most: int, time_s: float) -> StoredBackup:
        """Write a set unless nothing has changed since the last one, and remove the oldest files beyond `most`.

        Raises UsageError if it cannot be written.
        """
        before, kept = self._latest(drive, extent)
        result = StoredBackup(file=None, before=before) if kept is None else _since(before, kept, found, extent)
        if kept is not None and not (result.changed or result.another or _told_more(kept, found)):
            return result
        file = self.folder / file_stem(drive) / datetime.fromtimestamp(time_s, UTC).strftime(_NAMES[extent])
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            write_set(file, found)
            gone = self.files(drive, extent)[:-most]
            for each in gone:
                each.unlink(missing_ok=True)
        except OSError as error:
            raise UsageError(f"{file}: the backup cannot be written: {error.strerror or error}") from error
        trouble = self._committed(drive, [file, *gone], result) if self._git else ""
        return StoredBackup(file=file, before=before, changed=result.changed, another=result.another, trouble=trouble)

    def _committed(self, drive: str, files: Sequence[Path], result: StoredBackup) -> str:
        """Commit only these files; return the reason for a failure, "" on success."""
        count = len(result.changed)
        what = f"{count} parameter{'' if count == 1 else 's'} changed" if count else "first backup"
        if result.another and not count:
            what = "another drive or firmware"
        lines = [*result.another, *map(change_text, result.changed)]
        message = "\n".join([f"Back up {drive}: {what}", *([""] if lines else []), *lines])
        names = [str(each.relative_to(self.folder)) for each in files]
        if (git := shutil.which("git")) is None:
            return "git is not installed"
        try:
            for command in (["add", "--all", "--", *names], ["commit", "--quiet", "-m", message, "--", *names]):
                done = subprocess.run(  # noqa: S603 - names of files behind "--", and a message of ours
                    [git, *command], cwd=self.folder, capture_output=True, text=True, timeout=_GIT_S, check=False
                )
                if done.returncode:
                    return in_one_line(UsageError((done.stderr or done.stdout).strip() or "git printed no error"))
        except (OSError, subprocess.SubprocessError) as error:
            return in_one_line(error)
        return ""


def time_of(file: Path) -> float:
    """Return the time in the name of a backup file, in seconds since 1970."""
    return datetime.strptime(file.name.partition(".")[0], "%Y-%m-%dT%H-%M-%SZ").replace(tzinfo=UTC).timestamp()


def change_text(change: Difference) -> str:
    """Return a change in words: parameter, value before and value now."""
    named = f"{change.address} {change.name}".rstrip()
    return f"{named}: {change.left or '-'} -> {change.right or '-'}"


def _since(before: Path | None, kept: ParameterSet, found: ParameterSet, extent: Extent) -> StoredBackup:
    parts = WRITABLE if extent == "settings" else (*WRITABLE, "unknown")
    changed = [each for each in compare(kept, found, parts).differences if each.kind == "value"]
    return StoredBackup(file=None, before=before, changed=changed, another=tuple(_another(kept, found)))


def _another(kept: ParameterSet, found: ParameterSet) -> list[str]:
    told = [
        f"{key} was {text!r} and is {found.identity[key]!r}"
        for key, text in lasting_identity(kept.identity).items()
        if found.identity.get(key, text) != text
    ]
    for what in ("protocol", "model", "firmware"):
        was, now = getattr(kept, what), getattr(found, what)
        if was and now and was != now:
            told.append(f"{what} was {was!r} and is {now!r}")
    return told


def _told_more(kept: ParameterSet, found: ParameterSet) -> bool:
    """Return whether a set has parameters that the earlier one lacks, such as those that could not be read then."""
    parts = [*WRITABLE, "unknown"]
    return bool({each.address for each in found.of(parts)} - {each.address for each in kept.of(parts)})
