"""The work of backups: selection of the drive that is due, its reading, and the events about changes."""

from __future__ import annotations

import asyncio
import json
import logging
import time
from contextlib import closing
from functools import partial
from typing import TYPE_CHECKING, Any

from drivecomm.bus import carry_out_async
from drivecomm.commissioning.exploring import Logbook, logbook_path, unseen
from drivecomm.commissioning.parameter_sets import (
    back_up_async,
    backup_plan,
    file_stem,
    reading_everything,
    subject,
)
from drivecomm.errors import DriveCommError, FileFormatError, in_one_line
from drivecomm.server.backups.drift_watch import DriftWatch, SetReading
from drivecomm.server.backups.shelf import Shelf, change_text
from drivecomm.server.backups.unhurried import PacedDrive
from drivecomm.tomlfile import write_atomically

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from drivecomm.bus import AsyncDrive
    from drivecomm.commissioning.parameter_sets import Difference, ParameterSet
    from drivecomm.protocol import DriveConfig
    from drivecomm.server.backups.settings import BackupSettings, PlantBackups
    from drivecomm.server.backups.shelf import Extent, StoredBackup
    from drivecomm.server.core import Core

LOOK_S = 1.0
"""Period of the check for drives that are due."""
QUIET_S = 60.0
"""Seconds without a write to a drive before its backup: a running restore writes all the time."""
AGAIN_S = 600.0
"""Seconds until a drive that could not be read is tried again."""
BASELINES_LOOK_S = 5.0
"""Period of the check for changed baselines."""
_NAMED = 5
"""Number of changes that an event names; the files have all of them."""

_log = logging.getLogger("drivecomm.server")


class GaveWayError(Exception):
    """A backup was interrupted by more urgent work on its line; it is made later."""


class Backups:
    """The backups of a plant, which reads one drive of each line at a time when it is due.

    state: the folder for files that outlive the server. clock: returns the time, in seconds since 1970.
    """

    def __init__(
        self, core: Core, settings: PlantBackups, *, state: Path, clock: Callable[[], float] = time.time
    ) -> None:
        self._core = core
        self._state = state
        self._clock = clock
        self._times_file = state / "backups.json"
        self._times = _times_in(self._times_file)
        self._again_at: dict[tuple[str, Extent], float] = {}
        self._cannot: dict[str, str] = {}
        """Reasons for the latest failures, by drive; each is reported once."""
        self._working: dict[str, asyncio.Task[None]] = {}
        self._settings = settings
        self._shelf = Shelf(settings.folder, git=settings.git)
        self._drift = DriftWatch(core, state=state)

    def change(self, settings: PlantBackups) -> None:
        """Apply new settings; a backup that is under way finishes with the old ones."""
        self._settings = settings
        self._shelf = Shelf(settings.folder, git=settings.git)

    async def run(self) -> None:
        """Make backups and compare drives with their baselines, until cancelled."""
        await self._drift.load()
        looking = asyncio.create_task(self._look_at_baselines(), name="baselines")
        try:
            while True:
                for line in list(self._core.lines):
                    if line not in self._working and (due := self._due(line)) is not None:
                        task = asyncio.create_task(self._back_up(*due), name=f"backup on {line}")
                        self._working[line] = task
                        task.add_done_callback(partial(self._worked, line))
                await asyncio.sleep(LOOK_S)
        finally:
            working = [looking, *self._working.values()]
            for task in working:
                task.cancel()
            await asyncio.gather(*working, return_exceptions=True)

    async def _look_at_baselines(self) -> None:
        while True:
            try:
                began_s = {name: times["settings"] for name, times in self._times.items() if "settings" in times}
                await self._drift.look(self._shelf, began_s, self._settings.drives)
            except Exception:  # noqa: BLE001 - the server must not stop for this
                _log.exception("looking at baselines")
            await asyncio.sleep(BASELINES_LOOK_S)

    def _worked(self, line: str, _: asyncio.Task[None]) -> None:
        del self._working[line]

    def _due(self, line: str) -> tuple[DriveConfig, BackupSettings, Extent] | None:
        """Return the drive, settings and extent of the next backup of a line, or None if none is due.

        Readings of parameters come before full readings, and among equals the oldest backup comes first.
        """
        answering = set(self._core.lines[line].answering())
        found: list[tuple[int, float, int, DriveConfig, BackupSettings, Extent]] = []
        for place, drive in enumerate(self._core.plant.on_line(line)):
            settings = self._settings.drives.get(drive.name)
            if settings is None or drive.name not in answering or self._is_written(drive):
                continue
            extents: dict[Extent, float | None] = {"settings": settings.every_s, "everything": settings.everything_s}
            for urgency, (extent, every_s) in enumerate(extents.items()):
                last_s = self._times.get(drive.name, {}).get(extent, 0.0)
                if every_s is not None and self._is_over(last_s, every_s) and self._may_try(drive.name, extent):
                    found.append((urgency, last_s, place, drive, settings, extent))
        return min(found)[3:] if found else None

    def _is_over(self, last_s: float, every_s: float) -> bool:
        # A clock that was set back must not postpone a backup.
        return not 0 <= self._clock() - last_s < every_s

    def _may_try(self, drive: str, extent: Extent) -> bool:
        return self._clock() >= self._again_at.get((drive, extent), 0.0)

    def _is_written(self, drive: DriveConfig) -> bool:
        last_s = self._core.writes.last_s(drive.name)
        return last_s is not None and time.monotonic() - last_s < QUIET_S

    async def _back_up(self, drive: DriveConfig, settings: BackupSettings, extent: Extent) -> None:
        began_s = self._clock()
        try:
            found = await self._read(drive, settings, extent)
            read_s = self._clock()
            kept = await asyncio.to_thread(
                self._shelf.keep, drive.name, found, extent, most=settings.keep, time_s=read_s
            )
        except GaveWayError:
            return
        except Exception as error:  # noqa: BLE001 - the server must not stop for this
            if not isinstance(error, DriveCommError):
                _log.exception("backup of %s", drive.name)
            self._failed(drive, extent, in_one_line(error))
            return
        self._cannot.pop(drive.name, None)
        self._times.setdefault(drive.name, {})[extent] = began_s
        await asyncio.to_thread(self._remember_times)
        self._tell(drive, kept)
        if extent == "settings":
            # Not after a full reading, parts of which may be days old.
            await self._drift.backed_up(drive, SetReading(began_s, read_s, found), self._shelf)

    async def _read(self, drive: DriveConfig, settings: BackupSettings, extent: Extent) -> ParameterSet:
        line = self._core.line(drive.line)
        whom = line.drive(drive.name)

        def check() -> None:
            if self._is_written(drive) or self._core.lines.get(drive.line) is not line:
                raise GaveWayError
            if extent == "everything" and (due := self._due(drive.line)) is not None and due[2] == "settings":
                raise GaveWayError

        unhurried: Any = PacedDrive(whom, settings.share, check)
        if extent == "settings":
            return await back_up_async(unhurried)
        return await self._everything(whom, unhurried, drive.name)

    async def _everything(self, whom: AsyncDrive, unhurried: Any, name: str) -> ParameterSet:
        """Read everything that a drive holds, resuming where an earlier run was interrupted."""
        of = subject(whom)
        way = await asyncio.to_thread(backup_plan, of)
        path = logbook_path(self._state / f"backup of {file_stem(name)}.toml")
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        try:
            logbook = Logbook(path, drive=whom.name, model=whom.model, asked="values")
            with closing(logbook):
                found = await carry_out_async(unhurried, reading_everything(of, way, logbook, unseen))
        except FileFormatError:
            # Answers recorded from another drive or model are useless; the next attempt starts from the beginning.
            path.unlink(missing_ok=True)
            raise
        logbook.over()
        return found

    def _failed(self, drive: DriveConfig, extent: Extent, why: str) -> None:
        self._again_at[drive.name, extent] = self._clock() + AGAIN_S
        if self._cannot.get(drive.name) != why:
            self._cannot[drive.name] = why
            self._core.table.record_event("warning", f"cannot be backed up: {why}", drive=drive.name, line=drive.line)

    def _tell(self, drive: DriveConfig, kept: StoredBackup) -> None:
        happened, about = self._core.table.record_event, {"drive": drive.name, "line": drive.line}
        if kept.another and kept.before is not None:
            happened("warning", f"differs from its last backup, {kept.before.name}: {'; '.join(kept.another)}", **about)
        if kept.changed and kept.before is not None:
            named = [self._with_writer(drive, each) for each in kept.changed[:_NAMED]]
            if more := len(kept.changed) - len(named):
                named.append(f"and {more} more")
            happened("state", f"settings differ from backup {kept.before.name}: {', '.join(named)}", **about)
        if kept.trouble:
            happened("warning", f"its backup is not committed: {kept.trouble}", **about)

    def _with_writer(self, drive: DriveConfig, change: Difference) -> str:
        """Return a change as a text, with the audit record of its write if it was written through this server."""
        entry = change.right or change.left
        common = entry.common if entry else ""
        return change_text(change) + self._core.writes.words_for(drive.name, change.address, common)

    def _remember_times(self) -> None:
        self._times_file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        write_atomically(self._times_file, json.dumps(self._times, indent=1) + "\n")


def _times_in(file: Path) -> dict[str, dict[str, float]]:
    """Return the times of the last backups; without a readable file, all drives are due immediately."""
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
        return {str(drive): {str(kind): float(at) for kind, at in of.items()} for drive, of in content.items()}
    except (OSError, ValueError, AttributeError, TypeError):
        return {}
