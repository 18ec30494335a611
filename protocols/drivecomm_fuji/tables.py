"""The tables of the manuals, as data; tables.toml names the pages."""

from __future__ import annotations

import tomllib
from decimal import Decimal
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping

TABLES: Mapping[str, Any] = tomllib.loads(
    (Path(__file__).parent / "tables.toml").read_text(encoding="utf-8"), parse_float=Decimal
)
