"""Levels of names above a drive, as in IEC 62264 (ISA-95), for the key `levels` of a door."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.errors import suggestion
from drivecomm.tomlfile import Kind

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.tomlfile import TomlTable

SITES = ("enterprise", "site", "area")
"""Levels that have a name in `[server]`."""
PLANT, LINE = "plant", "line"
LEVELS = (*SITES, PLANT, LINE)
"""All levels, the highest first."""

LEVELS_KEY = Kind((dict,), 'a list of levels, such as ["site", "area", "line"]')
"""The key `levels` in the table of a door: the name of each level, in order.

The name of the line is empty, because it differs from drive to drive.
"""


def with_names(table: TomlTable, names: Mapping[str, str]) -> TomlTable:
    """Return the table of a door with the names of its levels filled in. Raises FileFormatError.

    names: names of the levels that the plant file names, including that of the plant itself.
    """
    listed = table.content.get("levels")
    if listed is None:
        return table
    if not isinstance(listed, list) or not listed:
        raise table.error(f"invalid levels = {listed!r:.80}; write {LEVELS_KEY.words}", "levels")
    for each in listed:
        if each not in LEVELS:
            raise table.error(
                f"levels: unknown level {each!r:.80}; {suggestion(str(each), LEVELS, 'there are')}", "levels"
            )
        if each in SITES and each not in names:
            raise table.error(f"levels: the {each} has no name; write {each} = in [server]", "levels")
    if listed != [each for each in LEVELS if each in listed]:
        raise table.error(f"list levels from highest to lowest, each once: {', '.join(LEVELS)}", "levels")
    return table.replaced("levels", {each: names.get(each, "") for each in listed})
