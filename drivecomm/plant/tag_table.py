"""Tags of a plant as a table for spreadsheets: one row for each value that a server of the plant polls.

Names, groups and deadbands are imported from the table; all other columns are read-only.
"""

from __future__ import annotations

import csv
import io
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivecomm.errors import DriveCommError, UsageError, in_one_line, suggestion
from drivecomm.line import STATUS
from drivecomm.models import load_model, parameter_at, quantities
from drivecomm.protocol import Tag, installed

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from drivecomm.plant.plant import Plant
    from drivecomm.protocol import DriveConfig, Model

TAG_COLUMNS = ("tag", "drive", "line", "parameter", "meaning", "unit", "group", "deadband")
"""Columns of every table; the columns of the doors follow."""

_NEEDED = ("drive", "parameter")
_TAKEN = ("tag", "group", "deadband")
"""Columns that are imported."""


def model_of(config: DriveConfig) -> Model | None:
    """Return the model of a drive, None if the plant does not name a readable model."""
    model = config.options.get("model")
    if model is None:
        return None
    try:
        return load_model(installed[config.protocol].package, config.protocol, model)
    except (DriveCommError, KeyError):
        # The row of the drive shows the reason.
        return None


def tag_cells(plant: Plant) -> Iterator[tuple[DriveConfig, str, dict[str, str]]]:
    """Yield each polled value of a plant: its drive, its name, and the cells of its row by `TAG_COLUMNS`."""
    for drive in plant.drives:
        model = model_of(drive)
        for name in _polled(drive):
            tag = drive.tags.get(name, Tag())
            meaning, unit = _facts(name, model)
            deadband = "" if tag.deadband is None else f"{tag.deadband:g}"
            cells = (tag.name, drive.name, drive.line, name, meaning, unit, tag.group, deadband)
            yield drive, name, dict(zip(TAG_COLUMNS, cells, strict=True))


def _polled(drive: DriveConfig) -> list[str]:
    return list(dict.fromkeys([STATUS, *(name for group in drive.poll for name in group.parameters)]))


def _facts(name: str, model: Model | None) -> tuple[str, str]:
    """Return the meaning and the unit of a value, empty if unknown."""
    if name == STATUS:
        return "state of the drive", ""
    if quantity := quantities().get(name):
        return quantity.meaning, quantity.unit
    info = None if model is None else parameter_at(name, model)
    return ("", "") if info is None else (info.title or info.name, info.unit)


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportedTags:
    """Tags in an imported table.

    tags: tags that differ from those of the plant, by drive and value; an empty `Tag` removes one. problems: one
    sentence for each invalid row. others: columns that are ignored.
    """

    tags: Mapping[str, Mapping[str, Tag]]
    problems: Sequence[str]
    others: Sequence[str]


def imported_tags(text: str, plant: Plant) -> ImportedTags:
    """Compare a table with a plant. Raises UsageError if it is not a table of tags.

    text: CSV with commas, semicolons or tabs. An empty cell removes the plant's entry; a missing column keeps all
    entries.
    """
    rows = _rows(text)
    _, first = next(rows, (1, []))
    head = [cell.strip().lower() for cell in first]
    _check_head(head)
    polled = {drive.name: (drive, _polled(drive)) for drive in plant.drives}
    now = {(drive.name, name): tag for drive in plant.drives for name, tag in drive.tags.items()}
    seen: dict[tuple[str, str], int] = {}
    problems: list[tuple[int, str]] = []
    for line, cells in rows:
        try:
            row = _row(head, cells)
            drive, name = _value_of(row, polled)
            _check_first(seen, (drive.name, name), line)
            now[drive.name, name] = _tag_of(row, drive.tags.get(name, Tag()), name)
        except UsageError as error:
            problems.append((line, in_one_line(error)))
    refused = {line for line, _ in problems}
    problems += _doubled(now, {value: line for value, line in seen.items() if line not in refused})
    tags: dict[str, dict[str, Tag]] = {}
    for (of, name), tag in now.items():
        if polled[of][0].tags.get(name, Tag()) != tag:
            tags.setdefault(of, {})[name] = tag
    return ImportedTags(
        tags=tags,
        problems=[f"line {line}: {problem}" for line, problem in sorted(problems)],
        others=[column for column in head if column and column not in {*_NEEDED, *_TAKEN, *TAG_COLUMNS}],
    )


def _check_head(head: Sequence[str]) -> None:
    for column in (*_NEEDED, *_TAKEN):
        if head.count(column) > 1:
            raise UsageError(f"the column {column} is there twice; leave one of them out")
    for column in _NEEDED:
        if column not in head:
            raise UsageError(f"the column {column} is missing; the first row names drive, parameter, and tag or group")
    if not set(_TAKEN) & set(head):
        raise UsageError("there is no column tag, group or deadband; name one of them in the first row")


def _rows(text: str) -> Iterator[tuple[int, list[str]]]:
    """Yield the rows that have content, each with its line number."""
    begin = text.partition("\n")[0]
    delimiter = max(",;\t", key=begin.count)
    reader, line = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter), 1
    try:
        for cells in reader:
            if any(map(str.strip, cells)) and not cells[0].startswith("sep="):
                yield line, cells
            line = reader.line_num + 1
    except csv.Error as error:
        raise UsageError(f"line {line} cannot be read as CSV: {error}") from error


def _row(head: Sequence[str], cells: Sequence[str]) -> dict[str, str]:
    if any(cells[len(head) :]):
        raise UsageError(f"there are {len(cells)} cells for {len(head)} columns")
    return dict(zip(head, map(str.strip, cells), strict=False))


def _check_first(seen: dict[tuple[str, str], int], value: tuple[str, str], line: int) -> None:
    if (first := seen.setdefault(value, line)) != line:
        raise UsageError(f"{' '.join(value)} is in line {first} already")


def _value_of(row: Mapping[str, str], polled: Mapping[str, tuple[DriveConfig, list[str]]]) -> tuple[DriveConfig, str]:
    drive, name = (row.get(column, "") for column in _NEEDED)
    if drive not in polled:
        raise UsageError(f"there is no drive {drive!r:.80}; {suggestion(drive, polled, 'the plant has')}")
    if name not in polled[drive][1]:
        raise UsageError(f"{drive} has no value {name!r:.80}; {suggestion(name, polled[drive][1], 'it has')}")
    return polled[drive][0], name


def _tag_of(row: Mapping[str, str], before: Tag, name: str) -> Tag:
    return Tag(
        name=row.get("tag", before.name),
        group=row.get("group", before.group),
        deadband=_deadband(row["deadband"], name) if "deadband" in row else before.deadband,
    )


def _deadband(text: str, name: str) -> float | None:
    if not text:
        return None
    if name == STATUS:
        raise UsageError("a status has no deadband; leave the cell empty")
    try:
        # Spreadsheets of many countries write a decimal comma.
        return float(text.replace(",", "."))
    except ValueError:
        raise UsageError(f"invalid deadband {text!r:.80}; write a number in the value's unit") from None


def _doubled(now: Mapping[tuple[str, str], Tag], lines: Mapping[tuple[str, str], int]) -> Iterator[tuple[int, str]]:
    """Yield line and problem of each row whose tag also belongs to another value."""
    names = Counter(tag.name for tag in now.values() if tag.name)
    for value, line in lines.items():
        tag = now.get(value, Tag())
        if names[tag.name] > 1:
            other = next(each for each, its in now.items() if its.name == tag.name and each != value)
            yield line, f"{' '.join(other)} has the tag {tag.name!r}, too; give each its own"
