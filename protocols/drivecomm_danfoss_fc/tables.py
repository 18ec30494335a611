"""The tables of the manuals, as data; tables.toml names the pages."""

from __future__ import annotations

import tomllib
from functools import cache
from pathlib import Path
from typing import Any


@cache
def table(name: str) -> dict[int, Any]:
    """Return a table by its name, with numbers for keys; read by who needs it, and not by who stops a motor."""
    return {int(number): each for number, each in _tables()[name].items()}


@cache
def _tables() -> dict[str, Any]:
    return tomllib.loads((Path(__file__).parent / "tables.toml").read_text(encoding="utf-8"))
