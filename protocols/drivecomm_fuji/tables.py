"""The tables of the manuals, as data; tables.toml names the pages."""

from __future__ import annotations

from drivecomm.protocol import tables_beside

TABLES = tables_beside(__file__, "tables.toml")
