"""Salvage of a damaged plant file: the drives in it that can still be stopped.

Only the facts needed for stopping are read: the port of each line, the drives on it, and their groups. All other faults
in the file are ignored, and an unreadable entry does not affect the others.
"""

from __future__ import annotations

import re
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from drivecomm.errors import FileFormatError, UsageError
from drivecomm.plant.plant import Plant, PlantLine
from drivecomm.protocol import SETTING_NAMES, DriveConfig, LineSettings, parse_drive
from drivecomm.tomlfile import parse_toml

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_ENTRY = re.compile(r"^[ \t]*\[\[[ \t]*(\w+)[ \t]*\]\].*$", re.MULTILINE)


def salvaged(path: Path) -> tuple[Plant, list[str]]:
    """Return the readable lines and drives of a plant file, and a sentence for each unreadable drive.

    Raises FileFormatError if the file cannot be opened, or has no readable line or drive.
    """
    try:
        text = path.read_bytes().decode("utf-8-sig", errors="replace")
    except OSError as error:
        raise FileFormatError(f"{path}: {error.strerror or error}") from error
    entries = list(_entries(text))
    lines = {line.name: line for kind, entry in entries if kind == "line" and (line := _line(entry))}
    drives: dict[str, DriveConfig] = {}
    lost = []
    for number, entry in enumerate((entry for kind, entry in entries if kind == "drive"), start=1):
        drive = _drive(entry, next(iter(lines)) if len(lines) == 1 else "")
        if drive is None or drive.line not in lines:
            name = entry.get("name", entry.get("drive", ""))
            lost.append(
                f"{path}: drive {number}{f' ({name})' if name else ''} cannot be read, so it is not stopped by itself"
            )
            continue
        if drive.name in drives:
            drive = replace(drive, name=f"{drive} on {drive.line}")
        drives[drive.name] = drive
    if not drives:
        raise FileFormatError(f"{path}: none of its drives can be read")
    return Plant(lines=tuple(lines.values()), drives=tuple(drives.values())), lost


def _entries(text: str) -> Iterator[tuple[str, dict[str, Any]]]:
    heads = list(_ENTRY.finditer(text))
    ends = [*(head.start() for head in heads[1:]), len(text)]
    for head, end in zip(heads, ends, strict=False):
        # A separate table, such as [drive.options], belongs to the entry above it.
        yield head[1], _content(re.sub(rf"(?m)^[ \t]*\[{head[1]}\.", "[", text[head.end() : end]))


def _content(text: str) -> dict[str, Any]:
    with suppress(FileFormatError):
        return parse_toml(text, "")
    entry: dict[str, Any] = {}
    for line in text.splitlines():
        if line.lstrip().startswith("["):
            break
        with suppress(FileFormatError):
            entry.update(parse_toml(line, ""))
    return entry


def _line(entry: dict[str, Any]) -> PlantLine | None:
    name, port, listen = (_text(entry, key) for key in ("name", "port", "listen"))
    if not name:
        return None
    settings: dict[str, Any] = {}
    for key in SETTING_NAMES:
        with suppress(UsageError):
            LineSettings(**{key: entry[key]} if key in entry else {})
            settings.update({key: entry[key]} if key in entry else {})
    return PlantLine(name=name, port=port, listen=listen, echo=entry.get("echo") is True, settings=settings)


def _drive(entry: dict[str, Any], only_line: str) -> DriveConfig | None:
    try:
        drive = parse_drive(_text(entry, "drive"))
    except UsageError:
        return None
    options = entry.get("options")
    return replace(
        drive,
        line=_text(entry, "line") or only_line,
        name=_text(entry, "name") or drive.name,
        groups=_groups(entry),
        options=options if isinstance(options, dict) else {},
    )


def _groups(entry: dict[str, Any]) -> tuple[str, ...]:
    """Return the groups of a drive, without names that could be addresses; a single group needs no brackets."""
    value = entry.get("groups")
    names = value if isinstance(value, list) else [value]
    return tuple(name for name in names if isinstance(name, str) and ":" not in name)


def _text(entry: dict[str, Any], key: str) -> str:
    value = entry.get(key)
    return value if isinstance(value, str) else ""
