"""Tables of a protocol in a TOML file next to its modules.

They hold the meanings of codes, for example: `11 = "unknown parameter"`.
"""

from __future__ import annotations

from decimal import Decimal
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping


@cache
def tables_beside(module: str, file: str) -> Mapping[str, Any]:
    """Return the tables of a TOML file, with exact decimals; the file is read on the first call.

    module: `__file__` of a module in the same folder.
    """
    import tomllib

    return tomllib.loads((Path(module).parent / file).read_text(encoding="utf-8"), parse_float=Decimal)


@cache
def code_texts(module: str, file: str) -> Mapping[int, str]:
    """Return the texts of a protocol's codes, by code; a key in the file is decimal (16) or hexadecimal (0x10)."""
    return {int(code, 16 if code.startswith("0x") else 10): text for code, text in tables_beside(module, file).items()}
