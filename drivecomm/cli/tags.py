"""Commands `tags export` and `tags import`: names of a plant's values in supervisory systems, as a spreadsheet."""

from __future__ import annotations

import csv
import io
from collections import Counter
from typing import TYPE_CHECKING

import click

from drivecomm.cli import options
from drivecomm.cli.commands import CliCommand
from drivecomm.cli.output import counted, emit, note, say, tell
from drivecomm.cli.output_files import force_option, must_be_free
from drivecomm.cli.values import FILE
from drivecomm.errors import FileFormatError, UsageError
from drivecomm.tomlfile import read_text_file, write_atomically

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from drivecomm.server import AddressesValues

_plant_argument = click.argument("plant", type=FILE, help="Plant file.")
_BYTE_ORDER_MARK = "\ufeff"


@click.command(cls=CliCommand)
@_plant_argument
@click.argument("file", type=FILE, required=False, help="The CSV file to write. Default: standard output.")
@force_option
@options.json
def export(*, plant: Path, file: Path | None, force: bool, json: bool) -> None:
    """Write each value that a server of the plant polls, with its tag and its address at each door, as CSV.

    No line is opened, and the server need not run.
    """
    must_be_free(file, "FILE", force=force)
    rows = list(_rows(plant))
    if json and file is None:
        for row in rows:
            emit(**row, drive_name=row["drive"])
        return
    from drivecomm.plant import TAG_COLUMNS

    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0] if rows else TAG_COLUMNS), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    if file is None:
        for line in text.getvalue().splitlines():
            say(line)
        return
    # Without the mark, spreadsheets assume the system's own character set.
    write_atomically(file, _BYTE_ORDER_MARK + text.getvalue())
    tell(f"{file}: {counted(len(rows), 'value')}", as_json=json, output=str(file), values=len(rows))


@click.command("import", cls=CliCommand)
@click.argument("file", type=FILE, help="The CSV file to read: as exported, with commas, semicolons or tabs.")
@_plant_argument
@options.json
def import_tags(*, file: Path, plant: Path, json: bool) -> None:
    """Set names, groups and deadbands of values in the plant file; its comments stay.

    Nothing is changed unless every row fits. A running server applies the tags when it next reads its plant file.
    """
    from drivecomm.plant import imported_tags, read_plant, with_usual_polls, write_tags
    from drivecomm.server import read_settings

    known = with_usual_polls(read_plant(plant))
    try:
        found = imported_tags(read_text_file(file, "a table of tags"), known)
    except UsageError as error:
        raise FileFormatError(f"{file}: {error}") from error
    for problem in found.problems:
        note(f"{file}, {problem}")
    if found.problems:
        rows = counted(len(found.problems), "row")
        raise FileFormatError(f"{file}: {rows} cannot be imported, so nothing was changed in {plant}; see above")
    kinds = {kind for kind, _ in read_settings(plant).doors}
    if others := [column for column in found.others if column.partition(" ")[0] not in kinds]:
        note(f"{file}: columns that are ignored: {', '.join(others)}")
    numbers = {drive.name: number for number, drive in enumerate(known.drives)}
    if found.tags:
        write_tags(plant, {numbers[drive]: tags for drive, tags in found.tags.items()})
    changed = sum(map(len, found.tags.values()))
    tell(f"{plant}: {counted(changed, 'tag')} changed", as_json=json, plant=str(plant), changed=changed)


def _rows(path: Path) -> Iterator[dict[str, str]]:
    """Yield the rows of the table of a plant, each with all columns."""
    from drivecomm.plant import read_plant, tag_cells, with_usual_polls
    from drivecomm.server import read_settings

    plant, settings = with_usual_polls(read_plant(path)), read_settings(path)
    doors = _address_columns(path)
    for drive, name, cells in tag_cells(plant):
        addresses = {column: door.address_of(settings.name, drive, name) for column, door in doors.items()}
        yield {**cells, **addresses}


def _address_columns(path: Path) -> dict[str, AddressesValues]:
    """Return the doors with addresses of values, by the names of their columns.

    A column has the kind of the door as its name, with a number for further doors of this kind.
    """
    from drivecomm.server import AddressesValues, kind_of_door, read_settings

    found: dict[str, AddressesValues] = {}
    numbers = Counter[str]()
    for kind, table in read_settings(path).doors:
        door = kind_of_door(kind)(table)
        if isinstance(door, AddressesValues):
            numbers[kind] += 1
            found[kind if numbers[kind] == 1 else f"{kind} {numbers[kind]}"] = door
    return found
