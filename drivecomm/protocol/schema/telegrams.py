"""The codec of a protocol, made of the forms of its telegrams.

Forms differ in constants and in leaves that are `deciding`: each rules out the forms that cannot have these bytes
there. Telegrams that cannot be distinguished are refused when they are declared. The deciding places and the meanings
of their contents are determined once. Reading, writing and measuring look at these places, and leave the rest to the
form.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any

from drivecomm.errors import TelegramError, UsageError
from drivecomm.protocol.schema.form import Form, message_of
from drivecomm.protocol.schema.telling_apart import Shape, measurer, reader, writer

if TYPE_CHECKING:
    from collections.abc import Hashable, Mapping

    from drivecomm.protocol import Direction, Message


class Telegrams:
    """Codec of some forms: measure, decode, encode, and messages from fields, as in `drivecomm.protocol.Codec`.

    requests, replies: the forms by their human-readable titles. Each form has a message class of its own, or shares it
    with others that differ in deciding fields or in `when`. alike: codecs with equal values read alike. Raises
    UsageError for telegrams that cannot be distinguished.

    A telegram with invalid content at a deciding place is read as the form of its length, or as the first form, which
    then reports the fault.
    """

    def __init__(
        self, requests: Mapping[str, Form[Any]], replies: Mapping[str, Form[Any]], *, alike: Hashable = None
    ) -> None:
        self.forms: dict[str, Form[Any]] = {**requests, **replies}
        """All forms by title, for `Protocol.forms`."""
        if not requests or not replies:
            raise UsageError("a protocol has requests and replies")
        if len(self.forms) < len(requests) + len(replies):
            raise UsageError("a request and a reply have the same title; a title names one form")
        self.alike = self if alike is None else alike
        sides: dict[Direction, list[Shape]] = {
            "request": [Shape(title, form) for title, form in requests.items()],
            "reply": [Shape(title, form) for title, form in replies.items()],
        }
        self._read = {side: reader(live) for side, live in sides.items()}
        self._measure = {side: measurer(live) for side, live in sides.items()}
        by_class: dict[type[Any], list[Form[Any]]] = {}
        for form in self.forms.values():
            by_class.setdefault(form.message, []).append(form)
        self._write = {message: writer(forms) for message, forms in by_class.items()}
        self._kinds = {
            side: [(kind, each.form.message) for each in live for kind in each.form.kinds]
            for side, live in sides.items()
        }
        self._blind_spots = lru_cache(maxsize=256)(self._found_by_trying)

    def measure(self, head: bytes, direction: Direction) -> int:
        """Return the length of the telegram that begins with these bytes, see `Codec.measure`."""
        return self._measure[direction](head)  # type: ignore[no-any-return]

    def decode(self, data: bytes, direction: Direction) -> Message:
        """Return the content of one telegram. Raises TelegramError."""
        if not data:
            raise TelegramError("length", "there is nothing to decode")
        message: Message = self._read[direction](data)
        return message

    def encode(self, message: Message) -> bytes:
        """Return the bytes of one telegram. Raises TelegramError for a field that does not fit or is superfluous."""
        write = self._write.get(type(message))
        if write is None:
            raise TelegramError("field", f"{type(message).__name__} is not a telegram of this protocol")
        return write(message)

    def message(self, given: Mapping[str, Any], direction: Direction) -> Message:
        """Build a message from fields as vectors name them; if there are several kinds, `kind` selects one."""
        kinds, several = self._kinds[direction], len({message for _, message in self._kinds[direction]}) > 1
        known = [(kind, message) for kind, message in kinds if not several or kind == given.get("kind")]
        if not known:
            names = ", ".join(dict.fromkeys(kind for kind, _ in kinds))
            raise TelegramError("field", f"the kind of a {direction} is one of {names}", field="kind")
        kind, chosen = known[0]
        message: Message = message_of(chosen, given, f"the {kind} telegram" if several else f"a {direction}")
        return message

    def blind_spots(self, data: bytes, direction: Direction) -> frozenset[int]:
        """Return the positions where a single wrong bit results in another sound telegram, found by trying each bit."""
        return self._blind_spots(data, direction)

    def _found_by_trying(self, data: bytes, direction: Direction) -> frozenset[int]:
        return frozenset(
            place
            for place, byte in enumerate(data)
            if any(
                self._is_sound(data[:place] + bytes([byte ^ 1 << bit]) + data[place + 1 :], direction)
                for bit in range(8)
            )
        )

    def _is_sound(self, data: bytes, direction: Direction) -> bool:
        try:
            self.decode(data, direction)
        except TelegramError:
            return False
        return True
