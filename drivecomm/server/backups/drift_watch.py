"""Monitoring of drift: comparisons of the drives' backups with their baselines, and reports of new differences."""

from __future__ import annotations

import asyncio
import logging
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from drivecomm.commissioning.drift import (
    baseline_path,
    drift_between,
    live_addresses,
    read_baseline,
    restore_command,
)
from drivecomm.commissioning.parameter_sets import read_set, subject
from drivecomm.errors import DriveCommError, FileFormatError, in_one_line
from drivecomm.server.backups.drift_file import read_drifts, write_drifts
from drivecomm.server.backups.drift_records import drift_record, first_seen, newly_changed, news
from drivecomm.server.backups.shelf import time_of
from drivecomm.server.drift_state import NOT_COMPARED, DriveDrift

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping

    from drivecomm.commissioning.drift import Drift
    from drivecomm.commissioning.parameter_sets import ParameterSet, SetSubject
    from drivecomm.protocol import DriveConfig
    from drivecomm.server.backups.shelf import Shelf
    from drivecomm.server.core import Core

_NO_BASELINE = DriveDrift(state="no baseline")
_NO_BACKUP = "the server has no backup of it yet"
_NOT_BACKED_UP = "the server does not back it up; write backup = true in [server], or for this drive"

_Stamp = tuple[int, ...] | None
"""Fingerprint of a file, which changes with it; None for a missing file."""
_log = logging.getLogger("drivecomm.server")


class SetReading(NamedTuple):
    """A parameter set of a drive, with the times at which its reading began and ended, in seconds since 1970."""

    began_s: float
    ended_s: float
    known: ParameterSet


class DriftWatch:
    """The monitor of all drives' drift, which it stores in `core.drift`.

    state: the folder for files that outlive the server.
    """

    def __init__(self, core: Core, *, state: Path) -> None:
        self._core = core
        self._file = state / "drift.json"
        self._seen: dict[str, tuple[_Stamp, bool]] = {}
        self._comparing = asyncio.Lock()
        """Held during a comparison, so that an older backup is not compared after a newer one."""

    async def load(self) -> None:
        """Load the drifts of an earlier run of the server."""
        known = await asyncio.to_thread(read_drifts, self._file)
        self._core.drift.update({name: drift for name, drift in known.items() if name in self._names()})

    async def backed_up(self, drive: DriveConfig, read: SetReading, shelf: Shelf) -> None:
        """Compare a drive that has just been read with its baseline. Raises nothing."""
        async with self._comparing:
            stamp = await asyncio.to_thread(_stamp, self._path(drive))
            await self._take(drive, stamp, shelf, lambda: read)

    async def look(self, shelf: Shelf, began_s: Mapping[str, float], drives: Collection[str]) -> None:
        """Compare the drives whose baseline files have changed with their newest backups. Raises nothing.

        began_s: when the last readings of drives began, by name. drives: drives that are backed up.
        """
        for name in self._core.drift.keys() - self._names():
            del self._core.drift[name]
            self._seen.pop(name, None)
        plant = list(self._core.plant.drives)
        stamps = await asyncio.to_thread(lambda: [_stamp(self._path(each)) for each in plant])
        for drive, stamp in zip(plant, stamps, strict=True):
            is_backed_up = drive.name in drives
            if self._seen.get(drive.name) == (stamp, is_backed_up):
                continue
            start_s = asyncio.get_running_loop().time()
            newest = partial(_newest, shelf, drive.name, began_s.get(drive.name))
            async with self._comparing:
                # A backup may have been compared with the same file while this task waited for the lock.
                if self._seen.get(drive.name) != (stamp, is_backed_up):
                    await self._take(drive, stamp, shelf, newest if is_backed_up else None)
            # Files of a large plant take long to read; rest, so that lines and doors go first.
            await asyncio.sleep(asyncio.get_running_loop().time() - start_s)

    async def _take(
        self, drive: DriveConfig, stamp: _Stamp, shelf: Shelf, last: Callable[[], SetReading | None] | None
    ) -> None:
        """Compare a drive with its current baseline.

        stamp: stamp of the baseline file, taken before. last: returns the last reading; None if the drive is not backed
        up.
        """
        before = self._core.drift.get(drive.name, NOT_COMPARED)
        writers: Mapping[str, str] = {}
        self._seen.pop(drive.name, None)
        try:
            # A drive that is unavailable now, as while its line is exchanged, is compared later.
            of = None if stamp is None else subject(self._core.line(drive.line).drive(drive.name))
            self._seen[drive.name] = stamp, last is not None
            if of is None:
                now = _NO_BASELINE
            elif (found := await asyncio.to_thread(_compared, self._path(drive), of, last)) is None:
                now = replace(before, state="not compared", cause=_NOT_BACKED_UP if last is None else _NO_BACKUP)
            else:
                now = await asyncio.to_thread(self._record, drive, found, before, shelf)
                writers = self._writers(drive, found[1], before)
        except Exception as error:  # noqa: BLE001 - one failure must not stop the backups
            if not isinstance(error, DriveCommError):
                _log.exception("comparing %s with its baseline", drive.name)
            now = replace(before, state="not compared", cause=in_one_line(error))
        if drive not in self._core.plant.drives:
            # The drive was exchanged meanwhile, and its name may mean another drive.
            self._seen.pop(drive.name, None)
            return
        self._core.drift[drive.name] = now
        self._tell(drive, before, now, writers)
        if now != before:
            await self._keep()

    def _record(self, drive: DriveConfig, found: tuple[float, Drift], before: DriveDrift, shelf: Shelf) -> DriveDrift:
        read_s, drift = found
        new = newly_changed(drift, before)
        first_s = first_seen(new, drift.now, shelf.sets(drive.name)) if new else {}
        plant = Path(self._core.plant.file).resolve()
        return drift_record(
            drift,
            before,
            read_s=read_s,
            # File names have whole seconds; a file of this second belongs to this backup.
            first_s={address: time_s for address, time_s in first_s.items() if time_s < int(read_s)},
            restore=restore_command(drive, baseline_path(plant, drive.name), plant),
        )

    def _writers(self, drive: DriveConfig, found: Drift, before: DriveDrift) -> Mapping[str, str]:
        """Return the caller of each change since the last comparison, if it was made through this server."""
        common = {each.address: each.right.common if each.right else "" for each in found.changed}
        after_s = before.compared_s or 0.0
        words_for = self._core.writes.words_for
        return {address: words_for(drive.name, address, name, after_s=after_s) for address, name in common.items()}

    def _tell(self, drive: DriveConfig, before: DriveDrift, now: DriveDrift, writers: Mapping[str, str]) -> None:
        happened, about = self._core.table.record_event, {"drive": drive.name, "line": drive.line}
        if now.state == "no baseline":
            if before.approved_s is not None:
                happened("warning", "its baseline is gone, so drift is no longer detected", **about)
        elif now.state == "not compared":
            if now.cause not in (before.cause, _NO_BACKUP, _NOT_BACKED_UP):
                happened("warning", f"cannot be compared with its baseline: {now.cause}", **about)
        else:
            for is_warning, text in news(before, now, writers):
                happened("warning" if is_warning else "state", text, **about)

    async def _keep(self) -> None:
        try:
            await asyncio.to_thread(write_drifts, self._file, dict(self._core.drift))
        except (OSError, ValueError, FileFormatError) as error:
            _log.warning("drift of drives is unknown after a restart: %s", in_one_line(error))

    def _names(self) -> set[str]:
        return {each.name for each in self._core.plant.drives}

    def _path(self, drive: DriveConfig) -> Path:
        return baseline_path(Path(self._core.plant.file), drive.name)


def _stamp(path: Path) -> _Stamp:
    try:
        told = path.stat()
    except FileNotFoundError:
        return None
    except OSError:
        # Reading the file reports the reason.
        return ()
    return told.st_mtime_ns, told.st_size, told.st_ino


def _newest(shelf: Shelf, drive: str, began_s: float | None) -> SetReading | None:
    """Return the newest backup of a drive: its last file, which may be older than its last reading.

    Raises FileFormatError for a damaged file, because an older one would not show the drive's current state.
    """
    if not (files := shelf.files(drive)):
        return None
    time_s = time_of(files[-1])
    began_s = time_s if began_s is None else began_s
    return SetReading(began_s, max(began_s, time_s), read_set(files[-1]))


def _compared(path: Path, of: SetSubject, last: Callable[[], SetReading | None] | None) -> tuple[float, Drift] | None:
    """Compare the latest reading with a baseline: a backup, or the baseline itself if it was read later.

    Returns None if nothing was read. Raises FileFormatError and UsageError.
    """
    approved = read_baseline(path)
    if last is None or (read := last()) is None:
        return None
    approved_s = approved.time.timestamp() if approved.time is not None else 0.0
    # The drive may have been approved while its backup was read, with values that were read later.
    read_s, now = (approved_s, approved) if approved_s > read.began_s else (read.ended_s, read.known)
    return read_s, drift_between(approved, now, live_addresses(of))
