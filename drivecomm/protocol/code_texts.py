"""What the codes of a protocol mean, in a TOML file beside its package's modules: `11 = "unknown parameter"`."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping


@cache
def code_texts(module: str, file: str) -> Mapping[int, str]:
    """Return the texts by code; the file is read when somebody first needs one. module: `__file__` of one beside it."""
    import tomllib  # noqa: PLC0415 - who only starts and stops drives does not need it

    table = tomllib.loads((Path(module).parent / file).read_text(encoding="utf-8"))
    return {int(code): text for code, text in table.items()}
