"""Telegrams that are sent again and again."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.protocol import Message

_LIMIT = 512
"""More than a poll plan asks of one drive; who goes through more messages than that gains nothing by keeping them."""


class Written:
    """Writes messages and keeps what it wrote, by the message object: a frozen message is always the same telegram.

    Equal messages are not looked for. That would take about as long as writing, and True is equal to 1.
    """

    def __init__(self, write: Callable[[Message], bytes]) -> None:
        self._write = write
        self._kept: dict[int, tuple[Message, bytes]] = {}

    def telegram(self, message: Message) -> bytes:
        """Return the bytes of a message. Raises what writing it raises."""
        kept = self._kept.get(id(message))
        if kept is not None:
            return kept[1]
        data = self._write(message)
        if len(self._kept) >= _LIMIT:
            self._kept.clear()
        # The message is kept too, so that no other object can come to have its identity.
        self._kept[id(message)] = (message, data)
        return data
