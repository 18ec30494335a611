"""Backup settings of a plant file, for backups that its server makes automatically.

[server]
backup = { every = "1 d", keep = 30, everything = "1 w", share = 0.02, folder = "backups", git = true }

[[line]]
backup = { share = 0.01 }           # for its drives; other settings as for the plant

[[drive]]
backup = false                      # no backup of this drive; or a table, as for a line
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from drivecomm.durations import UNITS, seconds_in
from drivecomm.tomlfile import CHOICE, NUMBER, TEXT, WHOLE

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from drivecomm.tomlfile import TomlTable

_OF_A_DRIVE = {"every": TEXT, "keep": WHOLE, "everything": TEXT, "share": NUMBER}
_OF_A_PLANT = {**_OF_A_DRIVE, "folder": TEXT, "git": CHOICE}
_SHORTEST_S = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class BackupSettings:
    """Backup settings of one drive.

    every_s: period in seconds between backups of its parameters. keep: number of files of each kind that are retained.
    everything_s: period in seconds between full readings; None for never. share: share of its line's time, above 0 and
    up to 1.
    """

    every_s: float = 86400.0
    keep: int = 30
    everything_s: float | None = None
    share: float = 0.02


@dataclass(frozen=True, slots=True, kw_only=True)
class PlantBackups:
    """Backup settings of a plant.

    folder: folder of the files. git: commit each change. drives: backed-up drives, by name.
    """

    folder: Path
    git: bool
    drives: Mapping[str, BackupSettings]


def read_backups(top: TomlTable) -> PlantBackups:
    """Return the backup settings of a plant file. Raises FileFormatError."""
    server = top.table("server")
    said = _said(server, _OF_A_PLANT)
    folder, git = (said or {}).pop("folder", "backups"), (said or {}).pop("git", False)
    lines = {line.content.get("name"): _merged(said, line) for line in top.tables("line")}
    only_line = next(iter(lines)) if len(lines) == 1 else None
    drives = {}
    for drive in top.tables("drive"):
        of_line = lines.get(drive.content.get("line", only_line))
        if (merged := _merged(of_line, drive)) is not None:
            drives[str(drive.content.get("name") or drive.content.get("drive"))] = BackupSettings(**merged)
    return PlantBackups(folder=top.beside(folder), git=git, drives=drives)


def _merged(above: Mapping[str, Any] | None, table: TomlTable) -> dict[str, Any] | None:
    if "backup" not in table.content:
        return None if above is None else dict(above)
    said = _said(table, _OF_A_DRIVE)
    return None if said is None else {**(above or {}), **said}


def _said(table: TomlTable, keys: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return the backup settings in one table, or None if it has none or disables backups."""
    said = table.content.get("backup", False)
    if isinstance(said, bool):
        return {} if said else None
    inner = table.table("backup")
    given = inner.take(keys)
    for key in ("every", "everything"):
        if key in given:
            given[f"{key}_s"] = _seconds(inner, key, given.pop(key))
    if given.get("keep", 1) < 1:
        raise inner.error(f"invalid keep = {given['keep']}; write how many files are kept, 1 or more", "keep")
    if not 0 < given.get("share", 1) <= 1:
        raise inner.error(f"invalid share = {given['share']:g}; write a share of the line, such as 0.02", "share")
    if not given.get("folder", "backups"):
        raise inner.error("folder is empty; leave it out", "folder")
    return given


def _seconds(table: TomlTable, key: str, text: str) -> float:
    seconds = seconds_in(text)
    if seconds is None or seconds < _SHORTEST_S:
        raise table.error(f'invalid {key} = "{text}"; write a number and {UNITS}, such as "1 d"', key)
    return seconds
