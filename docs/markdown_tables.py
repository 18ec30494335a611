"""Markdown tables, and code in their cells."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable


def table(heads: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """Return a table with one line for each row."""
    lines = [list(heads)]
    lines += [["---"] * len(lines[0]), *([_cell(text) for text in row] for row in rows)]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def code(text: object) -> str:
    """Return a text as code, even if it contains pipes or backticks."""
    shown = str(text)
    if "|" in shown:
        # Within backticks, a table would show the backslash of an escaped pipe.
        return f"<code>{escape(shown).replace('|', '&#124;')}</code>"
    return f"`` {shown} ``" if "`" in shown else f"`{shown}`"


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|") or " "
