"""Server settings of a plant file: its name, its files, its doors and its alarms.

[server]                            # all of it is optional
name = "hall 2"                     # the file's name without its ending, unless given
enterprise = "Example Mills"        # names above the plant's, for doors that list them as levels; also site, area
status_period_s = 1.0               # how often each drive's status is polled
users = "users.toml"                # users of network doors; beside the plant file, as all files named here
audit = "audit.jsonl"               # record of all commands; in the server's state folder unless given
read_rate = { per_s = 10, burst = 50 }   # values that a caller from a network may read from each line
history = { file = "history.sqlite", days = 30, megabytes = 1000 }
# values and events; false: no history
backup = { every = "1 d", keep = 30 }   # automatic backups of parameter sets; see server/backups/settings
[[door]]                            # a way into the plant for programs on other machines
kind = "http"                       # the kind of door; its other keys depend on it
[[alarm]]                           # its keys are read where alarms are
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from drivecomm.errors import suggestion
from drivecomm.server.backups.settings import PlantBackups, read_backups
from drivecomm.server.callers import LOCAL
from drivecomm.server.levels import PLANT, SITES, with_names
from drivecomm.server.rates import READ_RATE, Rate
from drivecomm.server.state_paths import audit_file, history_file
from drivecomm.tomlfile import SECONDS, SWITCH, TEXT, Kind, read_toml

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from drivecomm.tomlfile import TomlTable

_HISTORY_OR_NONE = Kind((bool, dict), 'false, or a table such as { file = "history.sqlite", days = 30 }')
_RATE_TABLE = Kind((dict,), "a table such as { per_s = 10, burst = 50 }")
_SERVER = {
    "name": TEXT,
    **dict.fromkeys(SITES, TEXT),
    "status_period_s": SECONDS,
    "users": TEXT,
    "audit": TEXT,
    "read_rate": _RATE_TABLE,
    "history": _HISTORY_OR_NONE,
    "backup": SWITCH,
}
_NUMBER = Kind((int, float), "a number above 0")
_RATE = {"per_s": _NUMBER, "burst": _NUMBER}
_HISTORY = {"file": TEXT, "days": _NUMBER, "megabytes": _NUMBER}
_LONGEST_PERIOD_S = 3600.0


@dataclass(frozen=True, slots=True, kw_only=True)
class HistorySettings:
    """The file of the history, and its limits in days and in megabytes."""

    file: Path
    days: float = 30.0
    megabytes: float = 1000.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ServerSettings:
    """The settings of a server.

    name: name of the plant. status_period_s: poll period of each drive's status. users: the users file for network
    doors, None without one. read_rate: limit of the values that one of these users reads from a line. history: None
    if no history is written. backups: which drives the server backs up, and how. doors: the kind of each door, and its
    own keys. alarms: their tables in the file.
    """

    name: str
    audit: Path
    backups: PlantBackups
    read_rate: Rate = READ_RATE
    status_period_s: float = 1.0
    users: Path | None = None
    history: HistorySettings | None = None
    doors: tuple[tuple[str, TomlTable], ...] = ()
    alarms: tuple[TomlTable, ...] = ()


def read_settings(path: Path) -> ServerSettings:
    """Return the server settings of a plant file. Raises FileFormatError with file, line, entry and reason."""
    top = read_toml(path, "a plant")
    table = top.table("server")
    given = table.take(_SERVER)
    for key in ("name", *SITES, "users", "audit"):
        if not given.get(key, "said"):
            raise table.error(f"{key} is empty; leave it out", key)
    for key in ("name", *SITES):
        if not given.get(key, "").isprintable():
            raise table.error(f"{key} has unprintable characters; leave them out", key)
    period = given.get("status_period_s", 1.0)
    if not 0 < period <= _LONGEST_PERIOD_S:
        raise table.error(f"invalid status_period_s = {period:g}; write seconds above 0", "status_period_s")
    name = given.get("name", path.stem)
    names = {PLANT: name, **{each: given[each] for each in SITES if each in given}}
    doors = tuple((kind, with_names(door, names)) for kind, door in map(_door, top.tables("door")))
    _check_networks(top, {kind for kind, _ in doors})
    return ServerSettings(
        name=name,
        status_period_s=float(period),
        users=path.parent / given["users"] if "users" in given else None,
        audit=path.parent / given["audit"] if "audit" in given else audit_file(path),
        backups=read_backups(top),
        read_rate=_read_rate(table) if "read_rate" in given else READ_RATE,
        history=_history(path, table, given.get("history", True)),
        doors=doors,
        alarms=tuple(top.tables("alarm")),
    )


def _read_rate(table: TomlTable) -> Rate:
    inner = table.table("read_rate")
    given = inner.take(_RATE)
    said = {"per_s": READ_RATE.per_s, "burst": READ_RATE.burst, **given}
    for key, least in (("per_s", 0.01), ("burst", 1)):
        if not said[key] >= least:
            raise inner.error(f"invalid {key} = {said[key]:g}; write {least:g} or more", key)
    return Rate(float(said["per_s"]), float(said["burst"]))


def _history(path: Path, table: TomlTable, said: Any) -> HistorySettings | None:
    if said is False:
        return None
    if said is True:
        return HistorySettings(file=history_file(path))
    inner = table.table("history")
    given = inner.take(_HISTORY)
    for key in ("days", "megabytes"):
        if not given.get(key, 1) > 0:
            raise inner.error(f"invalid {key} = {given[key]:g}; write {_NUMBER.words}", key)
    file = path.parent / given.pop("file") if given.get("file") else history_file(path)
    return HistorySettings(**{**given, "file": file})


def _door(table: TomlTable) -> tuple[str, TomlTable]:
    kind = table.content.get("kind")
    if not isinstance(kind, str) or not kind:
        raise table.error('write the kind of door, such as kind = "http"', "kind")
    if kind == LOCAL:
        raise table.error("the local door is always open; leave this one out", "kind")
    return kind, table.without("kind", table.name if "(" in table.name else f"{table.name} ({kind})")


def _check_networks(top: TomlTable, kinds: Iterable[str]) -> None:
    """Raise FileFormatError for a drive whose network names a kind of door that is not installed."""
    from importlib.metadata import entry_points

    known = sorted({*kinds, *(each.name for each in entry_points(group="drivecomm.doors"))})
    for drive in top.tables("drive"):
        network = drive.content.get("network", {})
        for kind in sorted(set(network) - {"write", *known} if isinstance(network, dict) else ()):
            raise drive.error(
                f"network: unknown kind of door {kind!r}; {suggestion(kind, known, 'there are')}", "network"
            )
