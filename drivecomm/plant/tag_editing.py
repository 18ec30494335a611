"""Tags written into a plant file; everything else stays as people wrote it, comments included."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from drivecomm.errors import FileFormatError
from drivecomm.tomlfile import parse_toml, read_text_file, write_atomically

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from drivecomm.protocol import Tag

_WHAT = "a plant"


def write_tags(file: Path, tags: Mapping[int, Mapping[str, Tag]]) -> None:
    """Set tags of drives in a plant file, by the position of the drive from 0; an empty `Tag` removes a tag.

    Raises FileFormatError if the file cannot be read or written, or if its notation cannot be edited.
    """
    import tomlkit
    from tomlkit.exceptions import TOMLKitError

    text = read_text_file(file, _WHAT)
    wanted: dict[str, Any] = parse_toml(text, f"{file}: cannot be read as {_WHAT}")
    wanted = deepcopy(wanted)
    for number, of_drive in tags.items():
        _set(wanted["drive"][number], of_drive, {})
    try:
        document: Any = tomlkit.parse(text)
        for number, of_drive in tags.items():
            drive = document["drive"][number]
            is_inline = isinstance(drive, tomlkit.items.InlineTable)
            end = [] if is_inline else _take_end(drive)
            _set(drive, of_drive, tomlkit.inline_table() if is_inline else tomlkit.table())
            _last_table(drive).value.body.extend(end)
        changed = tomlkit.dumps(document)
        if "\r\n" in text:
            changed = changed.replace("\r\n", "\n").replace("\n", "\r\n")
        done = parse_toml(changed, str(file)) == wanted
    except (TOMLKitError, FileFormatError):
        done = False
    if not done:
        raise FileFormatError(
            f"{file}: the tags cannot be written there; write [[drive]] for each drive, and try again"
        )
    write_atomically(file, changed)


def _set(drive: Any, tags: Mapping[str, Tag], new: Any) -> None:
    """Set tags in the table of a drive. new: table for the tags if there is none."""
    import tomlkit

    if "tags" not in drive:
        drive["tags"] = new
    for name, tag in tags.items():
        said = {key: value for key, value in asdict(tag).items() if value not in ("", None)}
        if not said:
            drive["tags"].pop(name, None)
            continue
        entry = tomlkit.inline_table()
        entry.update(said)
        drive["tags"][name] = entry
    if not drive["tags"]:
        del drive["tags"]


def _take_end(drive: Any) -> list[Any]:
    """Remove and return the comments and empty lines at the end of a table, which belong to the following table."""
    items: list[Any] = []
    while True:
        table = _last_table(drive)
        body: list[Any] = table.value.body
        if not body or body[-1][0] is not None:
            return items
        items.insert(0, body.pop())


def _last_table(table: Any) -> Any:
    """Return the table within a table that ends last, or the table itself."""
    import tomlkit

    body = table.value.body
    is_above = bool(body) and isinstance(body[-1][1], tomlkit.items.Table)
    return _last_table(body[-1][1]) if is_above else table
