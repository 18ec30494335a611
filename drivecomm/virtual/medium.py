"""The wire as a medium: whose characters are on it when, and what becomes of those that meet."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, TypeAlias

if TYPE_CHECKING:
    from drivecomm.protocol import LineSettings, VirtualDrive

Source: TypeAlias = Literal["master", "echo", "drive", "foreign"]

# Times are sums of floats; a character that is out but for a thousandth is out.
_TOLERANCE = 1e-3


@dataclass(slots=True, kw_only=True, eq=False)
class Transmission:
    """Characters on the wire from `began` until `ended`, in seconds of the line's clock.

    data: as they are on the wire; one that met another is shown as NUL and heard by nobody, as receivers drop
    characters with a wrong parity or stop bit. garbled: whether there is such a one, or the sender lost power in the
    middle. sender: the drive, None for the master, its echo and foreign traffic. taken: how many characters the
    master's port has heard already. spoilt: the places of those that met another, as ranges. agreed: every receiver
    hears it as if the sender had the settings that it shares with this receiver.
    """

    source: Source
    sender: VirtualDrive | None
    settings: LineSettings
    data: bytes
    began: float
    ended: float
    garbled: bool = False
    taken: int = 0
    agreed: bool = False
    spoilt: list[tuple[int, int]] = field(default_factory=list)

    def sound(self, first: int, last: int) -> bytes:
        """Return those of its characters from first up to last that met no other."""
        if not self.spoilt:
            return self.data[first:last]
        return bytes(
            character
            for place, character in enumerate(self.data[first:last], first)
            if not any(begin <= place < end for begin, end in self.spoilt)
        )

    def out_by(self, now: float) -> int:
        """Return how many of its characters are on the wire whole by then."""
        if now >= self.ended:
            return len(self.data)
        return min(len(self.data), int((now - self.began) / self.settings.character_s + _TOLERANCE))

    def end_of(self, number: int) -> float:
        """Return when so many characters of it are out, all of them if it has fewer."""
        return self.ended if number >= len(self.data) else self.began + number * self.settings.character_s

    def cut_off(self, now: float) -> None:
        """Send nothing after this."""
        if now < self.ended:
            self.data = self.data[: self.out_by(now)]
            self.ended = now
            self.garbled = True

    def garble(self, began: float, ended: float) -> None:
        """Spoil the characters that are on the wire between two times."""
        character_s = self.settings.character_s
        first = max(0, int((began - self.began) / character_s + _TOLERANCE))
        last = min(len(self.data), math.ceil((ended - self.began) / character_s - _TOLERANCE))
        if first < last:
            self.data = self.data[:first] + bytes(last - first) + self.data[last:]
            self.spoilt.append((first, last))
            self.garbled = True


class Medium:
    """All transmissions that can still meet another one."""

    def __init__(self) -> None:
        self._present: list[Transmission] = []

    def begin(self, new: Transmission) -> None:
        """Put a transmission on the wire, the latest of all so far: where it meets others, both are spoilt.

        An echo is what an adapter tells its own master. It occupies no wire, but the others spoil it.
        """
        present = [other for other in self._present if other.ended > new.began] if self._present else []
        for other in present:
            ended = min(other.ended, new.ended)
            if other.source == "echo" or new.source == "echo":
                local = other if other.source == "echo" else new
                remote = new if local is other else other
                if remote.source != "master":
                    local.garble(new.began, ended)
            else:
                other.garble(new.began, ended)
                new.garble(new.began, ended)
        present.append(new)
        self._present = present

    def cut_off(self, sender: VirtualDrive, now: float) -> None:
        """Let nothing follow of what this drive is sending."""
        for transmission in self._present:
            if transmission.sender is sender:
                transmission.cut_off(now)
