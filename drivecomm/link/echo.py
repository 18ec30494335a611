"""Filter for the echo of two-wire adapters that return what they send."""

from __future__ import annotations

from typing import Literal, TypeAlias

Echo: TypeAlias = Literal["off", "expect", "auto"]
"""Echo setting of an adapter.

off: an echo is an error. expect: an echo comes, whole, in part, or disturbed. auto: detect whether there is an echo.
"""


def in_place_of_echo(telegram: bytes, place: int, excused: int) -> bool:
    """Return whether a telegram stands where the echo should be, and so may be a disturbed echo.

    A disturbed echo can pass for a reply: with a check of one XOR byte, one in 256 does. place: number of bytes before
    the telegram. excused: number of bytes that may belong to the echo. A reply after an echo that lost characters
    extends beyond them.
    """
    return place + len(telegram) <= excused


class EchoFilter:
    """Filter that removes the echo of each request from the received bytes.

    Bytes are removed if they are exactly what was sent, or the beginning of that with nothing after it. All other
    bytes go to the framer, which skips them: an echo that lost or changed a character is usually not a telegram, and
    one that stands `in_place_of_echo` is not believed. `excused` is the number of bytes that may belong to the echo.

    While it is unknown whether there is an echo, and the reply may equal the request, returned bytes are `doubted`:
    they prove nothing until something follows them. If a reply has come after a possible disturbed echo, a returned
    request is not accepted as a reply until it is known whether there is an echo.
    """

    def __init__(self, mode: Echo) -> None:
        self.looking = mode != "off"
        """Whether an echo comes, or may come."""
        self._expected = mode == "expect"
        self._sent = b""
        self._held = b""
        self.excused = 0
        self.doubted = self._may_be_reply = False
        self._length, self._is_likely = 0, False
        self.missing = 0
        """Number of echo bytes that must still come before anything else can."""

    @property
    def is_over(self) -> bool:
        """Whether no echo of the last request can still come: it came whole, or this port has no echo."""
        return not self.looking or not self._sent

    def sent(self, data: bytes, *, mirrored: bool = False) -> None:
        """Record bytes that were just sent; the echo of earlier bytes may still come before theirs.

        mirrored: whether the reply may equal these bytes.
        """
        self._may_be_reply = mirrored and not (self._expected or self._sent)
        self.doubted = False
        self._sent += data
        self._length = len(self._sent)
        self.missing = len(self._sent) - len(self._held) if self._expected else 0
        self.excused = len(self._sent) if self._expected else 0

    def take(self, came: bytes) -> tuple[bytes, bytes]:
        """Return the whole echo if it is complete, and all other bytes that came."""
        if not self._sent:
            return b"", came
        self._held += came
        length = len(self._sent)
        if self._held[:length] == self._sent:
            echo, rest = self._sent, self._held[length:]
            self.doubted = self._may_be_reply and not self._is_likely
            self._expected = not self._may_be_reply
            self._done()
            self.excused = 0
            return echo, rest
        if self._sent.startswith(self._held):
            self.missing = length - len(self._held) if self._expected else 0
            return b"", b""
        return b"", self.give_up()

    def give_up(self) -> bytes:
        """Return the bytes held back as the beginning of an echo that never became whole."""
        held = self._held
        self._done()
        return held

    def answered(self, before: int) -> bool:
        """Record that the reply came. Returns True if an echo was expected and never came whole.

        before: number of bytes before the reply that are not the whole echo.
        """
        absent = self._expected and self.excused > 0
        self._expected, self.doubted = self._expected or self.doubted, False
        self._done()
        if not (before or self._expected):
            # A reply without an echo before it shows that this adapter has none.
            self.looking = False
        # A few bytes are noise; an echo has at least half of the request's length.
        self._is_likely = before * 2 >= self._length
        return absent

    def _done(self) -> None:
        self._sent = self._held = b""
        self.missing = 0
