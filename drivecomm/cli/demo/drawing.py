"""Pictures of telegrams for the tour: each field under its bytes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.table import Table

from drivecomm.registry import installed
from drivecomm.telegram import fields_of

if TYPE_CHECKING:
    from drivecomm.telegram import Message

_FIXED = {"", "length"}


def drawn(protocol: str, title: str, data: bytes, message: Message) -> Table:
    """Return a table of a telegram's bytes, field by field."""
    table = Table(title=title, title_justify="left", title_style="bold", show_edge=False, pad_edge=False)
    for heading in ("bytes", "field", "value", "meaning"):
        table.add_column(heading)
    values = fields_of(message)
    for piece, name, meaning in _pieces(protocol, data, values) or [(data, "", "")]:
        value = values.get(name, "")
        table.add_row(piece.hex(" ").upper(), name, f"{value}", meaning)
    return table


def _pieces(protocol: str, data: bytes, values: dict[str, object]) -> list[tuple[bytes, str, str]]:
    """Split the bytes by the form whose fields and sizes fit this telegram."""
    wanted = set(values) - {"kind"}
    for rows in installed[protocol].forms().values():
        named = {name for name, _, _ in rows} - _FIXED
        fixed = sum(int(size) for _, size, _ in rows if size != "n")
        open_rows = sum(size == "n" for _, size, _ in rows)
        if len(named & wanted) < min(len(wanted), len(named)) or len(data) < fixed or open_rows > 1:
            continue
        if not open_rows and len(data) != fixed:
            continue
        return _split(data, rows, len(data) - fixed)
    return []


def _split(data: bytes, rows: list[tuple[str, str, str]], rest: int) -> list[tuple[bytes, str, str]]:
    pieces = []
    at = 0
    for name, size, meaning in rows:
        length = rest if size == "n" else int(size)
        pieces.append((data[at : at + length], name, meaning))
        at += length
    return pieces
