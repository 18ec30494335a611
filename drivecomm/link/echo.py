"""Echo: some two-wire adapters hand back what they send. It is dropped before a reply is looked for."""

from __future__ import annotations

from typing import Literal, TypeAlias

Echo: TypeAlias = Literal["off", "expect", "auto"]
"""off: none comes, one that does is an error. expect: it comes, whole, in part, or disturbed. auto: see by itself."""


def in_place_of_echo(telegram: bytes, place: int, excused: int) -> bool:
    """Tell whether a telegram stands where the echo should be, which is then not known to be whole.

    It may be a disturbed echo that passes for a reply: of those whose check is one XOR, one in 256 does. place: how
    many bytes came before it. excused: how many bytes may belong to such an echo. A reply whose echo lost characters
    reaches beyond them.
    """
    return place + len(telegram) <= excused


class EchoFilter:
    """Drops the echo of each request from what comes after it.

    An echo is dropped where it is exactly what was sent, or begins so and ends there. Anything else goes on to the
    framer, which passes over it: an echo that lost or changed a character is mostly no telegram, and one that stands
    `in_place_of_echo` is not believed. `excused` says how many bytes may belong to the echo.

    Where it is not known yet whether there is an echo, what comes back of a request whose reply may be the request
    itself is `doubted`: it shows nothing until something follows it. Where a reply came behind what may have been a
    disturbed echo, such a telegram is no reply until it is known.
    """

    def __init__(self, mode: Echo) -> None:
        self.looking = mode != "off"
        """Whether there is, or may be, an echo."""
        self._expected = mode == "expect"
        self._sent = b""
        self._held = b""
        self.excused = 0
        self.doubted = self._may_be_reply = False
        self._length, self._is_likely = 0, False
        self.missing = 0
        """How many bytes of the echo must still come before there can be anything else."""

    @property
    def is_over(self) -> bool:
        """Whether no echo of what was sent last can still come: it came whole, or there is none on this port."""
        return not self.looking or not self._sent

    def sent(self, data: bytes, *, mirrored: bool = False) -> None:
        """Take note of what was sent just now; the echo of what was sent before may still come in front of it.

        mirrored: the reply may be just this.
        """
        self._may_be_reply = mirrored and not (self._expected or self._sent)
        self.doubted = False
        self._sent += data
        self._length = len(self._sent)
        self.missing = len(self._sent) - len(self._held) if self._expected else 0
        self.excused = len(self._sent) if self._expected else 0

    def take(self, came: bytes) -> tuple[bytes, bytes]:
        """Return the whole echo if it is there now, and what else came."""
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
        """Return what was held back as the beginning of an echo; it never became a whole one."""
        held = self._held
        self._done()
        return held

    def answered(self, before: int) -> bool:
        """Take note that the reply came, and how many bytes came before it that were not the whole echo.

        Returns whether an echo was expected and never came whole.
        """
        absent = self._expected and self.excused > 0
        self._expected, self.doubted = self._expected or self.doubted, False
        self._done()
        if not (before or self._expected):
            # There was a reply and no echo before it: this adapter has none.
            self.looking = False
        # A byte of noise is none.
        self._is_likely = before * 2 >= self._length
        return absent

    def _done(self) -> None:
        self._sent = self._held = b""
        self.missing = 0
