"""Names of drive groups in a plant file; each must differ from every other word that names drives in a command."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivecomm.protocol import DriveConfig
    from drivecomm.tomlfile import TomlTable

_KEY = "groups"


def checked_groups(names: Sequence[str], table: TomlTable) -> tuple[str, ...]:
    """Return the groups of a drive. Raises FileFormatError for an invalid name and for a name given twice.

    table: table of the drive.
    """
    for name in names:
        if why := _why_not(name):
            raise table.error(f"invalid group {name!r:.80}; {why}", _KEY)
        if names.count(name) > 1:
            raise table.error(f"the group {name!r:.80} is listed twice; leave one of them out", _KEY)
    return tuple(names)


def check_apart(drives: Sequence[DriveConfig], tables: Sequence[TomlTable]) -> None:
    """Raise FileFormatError for a group that has the name of a drive.

    tables: tables of these drives, in the same order.
    """
    names = {drive.name for drive in drives}
    for drive, table in zip(drives, tables, strict=True):
        for group in drive.groups:
            if group in names:
                raise table.error(f"the group {group!r:.80} has the name of a drive; rename one of them", _KEY)


def _why_not(name: str) -> str:
    """Return advice on an invalid group name, or an empty string if the name is valid."""
    if not name or not name.isprintable() or name != name.strip():
        return "write printable characters, without spaces around them"
    # In a command, a comma begins the options of a drive, a colon its address, and a dash an option of the command.
    if "," in name or ":" in name or name.startswith("-"):
        return "write a name without commas and colons that does not begin with a dash"
    return "stop --all means all drives already; choose another name" if name.casefold() == "all" else ""
