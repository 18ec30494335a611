"""Poll plans as files.

A plan is a TOML file:

format = 1

[[drive]]
name = "pump"                       # what [[poll]] and the results call it
drive = "vabus:1"                   # PROTOCOL:ADDRESS
port = "/dev/ttyUSB0"               # optional: its line, where a plan has several
options = { model = "agile" }       # optional: what Bus.drive takes
reply_delay_s = 0.005               # optional: for a forecast

[[poll]]
drive = "pump"
parameters = ["481", "actual_frequency"]
period_s = 0.2                      # optional: 1.0 unless given, 0 for as often as there is time
priority = 1                        # optional: larger goes first among the overdue
options = { type = "long" }         # optional: the protocol's own for reading
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.errors import DriveCommError, FileFormatError, meant
from drivecomm.polling.plan import Plan, PlannedDrive, PlannedRead
from drivecomm.tomlfile import read_toml

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

_FORMAT = 1
# No number of a plan is larger, and larger ones are too much for a float.
_LARGEST = 2**63

_DRIVE_KEYS: Mapping[str, tuple[type, ...]] = {
    "name": (str,),
    "drive": (str,),
    "port": (str,),
    "options": (dict,),
    "reply_delay_s": (int, float),
}
_POLL_KEYS: Mapping[str, tuple[type, ...]] = {
    "drive": (str,),
    "parameters": (list,),
    "period_s": (int, float),
    "priority": (int,),
    "options": (dict,),
}


def read_plan(path: Path) -> Plan:
    """Read a plan file. Raises FileFormatError with the file's name, the entry and what is wrong in it."""
    return plan_in(read_toml(path, "a poll plan").content, path)


def plan_in(content: Mapping[str, Any], path: Path) -> Plan:
    """Return the plan that a file says. Raises as `read_plan` does."""
    try:
        return _plan(content)
    except DriveCommError as error:
        raise FileFormatError(f"{path}: {error}") from error


def _plan(content: Mapping[str, Any]) -> Plan:
    if content.get("format") != _FORMAT:
        raise FileFormatError(f"a poll plan begins with format = {_FORMAT}")
    _no_others(content, {"format": (), "drive": (), "poll": ()}, "the file")
    drives: dict[str, PlannedDrive] = {}
    for number, entry in enumerate(_tables(content, "drive"), start=1):
        drive = _drive(entry, f"drive {number}")
        if drive.name in drives:
            raise FileFormatError(f"two drives are named {drive.name!r}")
        drives[drive.name] = drive
    reads: list[PlannedRead] = []
    for number, entry in enumerate(_tables(content, "poll"), start=1):
        reads += _reads(entry, drives, f"poll {number}")
    return Plan(reads=tuple(reads))


def _tables(content: Mapping[str, Any], key: str) -> list[Mapping[str, Any]]:
    found = content.get(key)
    if not isinstance(found, list) or not all(isinstance(entry, dict) for entry in found):
        raise FileFormatError(f"a plan has one or more [[{key}]]")
    return found


def _drive(entry: Mapping[str, Any], where: str) -> PlannedDrive:
    _check(entry, _DRIVE_KEYS, ("drive",), where)
    protocol, colon, address = entry["drive"].partition(":")
    if not colon or not protocol or not address.isascii() or not address.isdigit():
        raise FileFormatError(f"{where}: {entry['drive']!r} names no drive; write PROTOCOL:ADDRESS, such as vabus:1")
    return PlannedDrive(
        protocol=protocol,
        address=int(address),
        options=entry.get("options", {}),
        name=entry.get("name", ""),
        port=entry.get("port", ""),
        reply_delay_s=entry.get("reply_delay_s"),
    )


def _reads(entry: Mapping[str, Any], drives: Mapping[str, PlannedDrive], where: str) -> list[PlannedRead]:
    _check(entry, _POLL_KEYS, ("drive", "parameters"), where)
    if entry["drive"] not in drives:
        known = meant(entry["drive"], drives, "it has")
        raise FileFormatError(f"{where}: there is no drive {entry['drive']!r} in this plan; {known}")
    parameters = entry["parameters"]
    if not parameters or not all(isinstance(parameter, str) and parameter for parameter in parameters):
        raise FileFormatError(f'{where}: parameters is a list of texts, such as ["481"]')
    return [
        PlannedRead(
            drive=drives[entry["drive"]],
            parameter=parameter,
            period_s=float(entry.get("period_s", 1.0)),
            priority=entry.get("priority", 0),
            options=entry.get("options", {}),
        )
        for parameter in parameters
    ]


def _check(
    entry: Mapping[str, Any], known: Mapping[str, tuple[type, ...]], needed: tuple[str, ...], where: str
) -> None:
    _no_others(entry, known, where)
    for key in needed:
        if key not in entry:
            raise FileFormatError(f"{where}: the key {key!r} is missing")
    for key, value in entry.items():
        if not isinstance(value, known[key]) or isinstance(value, bool):
            raise FileFormatError(f"{where}: {key} cannot be {value!r}")
        if isinstance(value, int) and abs(value) > _LARGEST:
            raise FileFormatError(f"{where}: {key} is too large a number")


def _no_others(entry: Mapping[str, Any], known: Mapping[str, tuple[type, ...]], where: str) -> None:
    unknown = sorted(set(entry) - set(known))
    if unknown:
        raise FileFormatError(f"{where}: {unknown[0]!r} is no key here; {meant(unknown[0], known, 'they are')}")
