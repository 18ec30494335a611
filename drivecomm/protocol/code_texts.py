"""Tables of a protocol in a TOML file beside its package's modules: what its codes mean, `11 = "unknown parameter"`."""

from __future__ import annotations

from decimal import Decimal
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping


@cache
def tables_beside(module: str, file: str) -> Mapping[str, Any]:
    """Return the tables of a file, decimals exactly; it is read when somebody first needs one.

    module: `__file__` of one beside it.
    """
    import tomllib

    return tomllib.loads((Path(module).parent / file).read_text(encoding="utf-8"), parse_float=Decimal)


@cache
def code_texts(module: str, file: str) -> Mapping[int, str]:
    """Return texts by code; a key is 16 or 0x10."""
    return {int(code, 16 if code.startswith("0x") else 10): text for code, text in tables_beside(module, file).items()}
