"""Telegrams that begin like others of their protocol and differ from them only in length."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.errors import TelegramError
from drivecomm.protocol.schema.telegrams import Telegrams

if TYPE_CHECKING:
    from collections.abc import Hashable, Mapping

    from drivecomm.protocol import Direction, Message
    from drivecomm.protocol.schema.form import Form


class TelegramsByLength(Telegrams):
    """Codec of some forms, and of further forms that are no shorter and differ from the first ones only in length.

    further: the codec of the further forms. A receiver waits for the rest of such a telegram only if the bytes received
    so far are not a sound telegram by themselves. Therefore reading and writing refuse a further telegram that begins
    with a sound telegram.
    """

    def __init__(
        self,
        requests: Mapping[str, Form[Any]],
        replies: Mapping[str, Form[Any]],
        *,
        further: Telegrams,
        alike: Hashable = None,
    ) -> None:
        super().__init__(requests, replies, alike=alike)
        self._further = further
        self.forms |= further.forms
        for side, kinds in self._kinds.items():
            kinds += [each for each in further._kinds[side] if each not in kinds]  # noqa: SLF001 - an object of the same class

    def measure(self, head: bytes, direction: Direction) -> int:
        """Return the length of the telegram that begins with these bytes, see `Codec.measure`."""
        size = super().measure(head, direction)
        if not 0 < size <= len(head):
            return size
        longer = self._further.measure(head, direction)
        return longer if longer > size and not self._is_whole(head[:size], direction) else size

    def decode(self, data: bytes, direction: Direction) -> Message:
        """Return the content of one telegram. Raises TelegramError."""
        try:
            return super().decode(data, direction)
        except TelegramError:
            if not data or not self.measure(data, direction) == self._further.measure(data, direction) == len(data):
                raise
        return self._further.decode(data, direction)

    def encode(self, message: Message) -> bytes:
        """Return the bytes of one telegram. Raises TelegramError for a field that does not fit or is superfluous."""
        try:
            return super().encode(message)
        except TelegramError as error:
            try:
                data = self._further.encode(message)
            except TelegramError:
                raise error from None
        sides = [side for side, kinds in self._kinds.items() if any(each is type(message) for _, each in kinds)]
        if not any(self.measure(data, side) == len(data) for side in sides):
            raise TelegramError("field", f"this {message.kind} telegram begins with a complete shorter one")
        return data

    def _is_whole(self, data: bytes, direction: Direction) -> bool:
        try:
            super().decode(data, direction)
        except TelegramError:
            return False
        return True
