"""The tables of a record, the same in PostgreSQL and SQLite; docs/how-to/centre.md describes each column.

Repeated data is stored once and referenced by number: quantities, and remarks, which combine unit, quality, text and
note. A value takes about 150 bytes with its index, and the curve of a quantity is one range of the primary key.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, NamedTuple, TypeAlias

from drivecomm.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

VERSION = 1
"""Version of the tables; a record keeps its own in the table `record`."""

UPGRADES: Mapping[int, tuple[str, ...]] = {}
"""SQL that upgrades the tables from each earlier version to the next one, for PostgreSQL and SQLite alike."""

Kind: TypeAlias = Literal["identity", "integer", "time", "number", "text"]


class TableShape(NamedTuple):
    """Columns of a table. key: columns of its unique key."""

    columns: Mapping[str, Kind]
    key: tuple[str, ...]


TABLES: Mapping[str, TableShape] = {
    "plant": TableShape(
        {
            "id": "identity",
            "name": "text",
            "state": "text",
            "version": "text",
            "file": "text",
            "file_sha256": "text",
            "file_read": "time",
        },
        ("name",),
    ),
    "quantity": TableShape(
        {"id": "identity", "plant": "integer", "drive": "text", "name": "text"}, ("plant", "drive", "name")
    ),
    "remark": TableShape(
        {"id": "identity", "unit": "text", "quality": "text", "text": "text", "note": "text"},
        ("unit", "quality", "text", "note"),
    ),
    "value": TableShape(
        {
            "quantity": "integer",
            "time": "time",
            "number": "number",
            "string": "text",
            "remark": "integer",
            "source_time": "time",
        },
        ("quantity", "time"),
    ),
    "event": TableShape(
        {
            "plant": "integer",
            "time": "time",
            "number": "integer",
            "kind": "text",
            "text": "text",
            "drive": "text",
            "line": "text",
            "who": "text",
            "alarm": "text",
        },
        ("plant", "time", "number"),
    ),
    "command": TableShape(
        {
            "plant": "integer",
            "time": "time",
            "row": "integer",
            "done_time": "time",
            "id": "text",
            "who": "text",
            "door": "text",
            "drive": "text",
            "verb": "text",
            "arguments": "text",
            "outcome": "text",
            "text": "text",
        },
        ("plant", "time", "row"),
    ),
    "alarm": TableShape(
        {
            "plant": "integer",
            "id": "text",
            "rule": "text",
            "drive": "text",
            "text": "text",
            "since": "time",
            "over": "time",
            "times": "integer",
            "acknowledged_by": "text",
            "acknowledged": "time",
            "ended": "time",
        },
        ("plant", "id"),
    ),
}

SAMPLE = """
CREATE VIEW sample AS
SELECT plant.name AS plant, quantity.drive, quantity.name AS quantity, value.time, value.number, value.string,
    remark.unit, remark.quality, remark.text, remark.note, value.source_time
FROM value
JOIN quantity ON quantity.id = value.quantity
JOIN plant ON plant.id = quantity.plant
JOIN remark ON remark.id = value.remark
"""


def upgrade(place: str, found: int, other: str) -> Iterator[str]:
    """Yield the SQL that upgrades a record from version `found` of its tables to `VERSION`; nothing if they are equal.

    other: the kind of place to name instead. Raises UsageError for the tables of a newer drivecomm.
    """
    if found not in (*UPGRADES, VERSION):
        raise UsageError(
            f"{place}: its tables were created by a newer drivecomm (version {found}, this one knows {VERSION}); "
            f"update drivecomm, or name another {other}"
        )
    for version in range(found, VERSION):
        yield from UPGRADES[version]
        yield f"UPDATE record SET version = {version + 1}"  # noqa: S608 - the version is a constant


def statements(types: Mapping[Kind, str]) -> Iterator[str]:
    """Yield the statements that create the tables. types: SQL type of each kind of column."""
    yield "CREATE TABLE record (version integer NOT NULL)"
    for name, table in TABLES.items():
        columns = [
            f"{column} {types[kind]}" + " NOT NULL" * (column in table.key) for column, kind in table.columns.items()
        ]
        # An identity column is itself the primary key.
        unique = "UNIQUE" if "id" in table.columns and table.columns["id"] == "identity" else "PRIMARY KEY"
        yield f"CREATE TABLE {name} ({', '.join(columns)}, {unique} ({', '.join(table.key)}))"
    yield SAMPLE
    yield f"INSERT INTO record VALUES ({VERSION})"  # noqa: S608 - the version is a constant
