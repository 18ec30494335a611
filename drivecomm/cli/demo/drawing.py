"""Pictures of telegrams for the tour: each field under its bytes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rich.table import Table

from drivecomm.errors import TelegramError
from drivecomm.protocol import fields_of, installed

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivecomm.protocol import Message
    from drivecomm.protocol.schema import Form


def drawn(protocol: str, data: bytes, message: Message) -> Table:
    """Return a table of a telegram's bytes, field by field."""
    table = Table(show_edge=False, pad_edge=False)
    for heading in ("bytes", "field", "value", "meaning"):
        table.add_column(heading)
    values = fields_of(message)
    for piece, name, meaning in _pieces(protocol, data, message):
        table.add_row(piece.hex(" ").upper(), name, str(values.get(name, "")), meaning)
    return table


def _pieces(protocol: str, data: bytes, message: Message) -> list[tuple[bytes, str, str]]:
    """Split the bytes by the form that reads this message from them."""
    for form in installed[protocol].forms().values():
        if form.message is type(message) and _reads(form, data):
            rows = form.describe()
            rest = len(data) - sum(int(size) for _, size, _ in rows if size != "n")
            return list(_split(data, rows, rest))
    return [(data, "", "")]


def _reads(form: Form[Any], data: bytes) -> bool:
    try:
        form.parse(data)
    except TelegramError:
        return False
    return True


def _split(data: bytes, rows: list[tuple[str, str, str]], rest: int) -> Iterator[tuple[bytes, str, str]]:
    at = 0
    for name, size, meaning in rows:
        length = rest if size == "n" else int(size)
        yield data[at : at + length], name, meaning
        at += length
