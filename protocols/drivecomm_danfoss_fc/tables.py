"""The tables of the manuals, as data; tables.toml names the pages."""

from __future__ import annotations

from functools import cache
from typing import Any

from drivecomm.protocol import tables_beside


@cache
def table(name: str) -> dict[int, Any]:
    """Return a table by its name, with numbers for keys; read by who needs it, and not by who stops a motor."""
    return {int(number): each for number, each in tables_beside(__file__, "tables.toml")[name].items()}
