"""A port whose other end is a script: characters take their time, on a clock that costs nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from drivecomm.protocol import LineSettings

if TYPE_CHECKING:
    from drivecomm.testing.script import Arriving, Script


class _Character(NamedTuple):
    ends: float
    byte: int
    echo: bool = False


class ScriptedPort:
    """The master's end of a line on which a script is played.

    echo: it hears what it sends. in_lumps: bytes are handed over when the last one of a telegram is there, as by an
    adapter that collects them. The script is given before the first byte is sent.
    """

    paced = True
    real_time = False
    descriptor = None

    def __init__(self, *, echo: bool = False, in_lumps: bool = False) -> None:
        self._script: Script | None = None
        self._echo = echo
        self._in_lumps = in_lumps
        self._settings = LineSettings()
        self._time = 0.0
        self._sending_until = 0.0
        self._coming: list[_Character] = []

    def follow(self, script: Script) -> None:
        """Play this script from now on."""
        self._script = script
        self._come(script.begin(self._time))

    def wire_s(self, characters: float) -> float:
        """Return how long so many characters take with the master's line settings."""
        return self._settings.wire_s(characters)

    @property
    def unread(self) -> bytes:
        """What the master has not read yet, come or still to come; its own echo left out."""
        return bytes(character.byte for character in self._coming if not character.echo)

    def now(self) -> float:
        """Return the time in seconds since the beginning."""
        return self._time

    def wall_time(self) -> float:
        """Return the same time."""
        return self._time

    def configure(self, settings: LineSettings) -> str:
        """Set the line settings, by which characters take their time."""
        self._settings = settings
        return ""

    def write(self, data: bytes) -> None:
        """Let the script judge what is sent, and answer it. Raises CheckFailure for anything that is not in it."""
        began = max(self._time, self._sending_until)
        self._sending_until = began + self.wire_s(len(data))
        if self._echo:
            self._coming += [_Character(began + self.wire_s(number), byte, True) for number, byte in enumerate(data, 1)]
        if self._script is not None:
            self._come(self._script.sent(data, began))

    def read(self, until: float, at_least: int) -> bytes:
        """Let time pass until this many bytes have come, or until then."""
        wanted = max(1, at_least)
        ready = self._coming[wanted - 1].ends if len(self._coming) >= wanted else until
        self._time = max(self._time, min(ready, until))
        return self.take()

    def take(self) -> bytes:
        """Return what has come by now."""
        came = [character.byte for character in self._coming if character.ends <= self._time]
        self._coming = self._coming[len(came) :]
        return bytes(came)

    def hold_back(self, at_least: int) -> None:
        """Nothing to hold back: there is no descriptor."""

    def wait(self, until: float) -> None:
        """Let time pass."""
        self._time = max(self._time, until)

    def close(self) -> None:
        """Nothing to give back."""

    def _come(self, arriving: list[Arriving]) -> None:
        for each in arriving:
            for number, byte in enumerate(each.data, 1):
                ends = each.ends if self._in_lumps else each.begins + self.wire_s(number)
                self._coming.append(_Character(ends, byte))
