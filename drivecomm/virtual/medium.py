"""The wire: whose characters are on it when, and what becomes of those that collide."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from drivecomm.protocol import LineSettings
from drivecomm.virtual.uart import heard

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.protocol import VirtualDrive

Source: TypeAlias = Literal["master", "echo", "drive", "foreign"]

# Times are sums of floats; a character that is out but for a thousandth is out.
_TOLERANCE = 1e-3
# What a master never reads is lost, as in the buffer of a port.
_ROOM = 65536
_MOST_AUDIBLE = 256


@dataclass(slots=True, kw_only=True, eq=False)
class Transmission:
    """Characters on the wire from `began` until `ended`, in seconds of the line's clock.

    data: as they are on the wire; one that met another is shown as NUL and heard by nobody, as receivers drop
    characters with a wrong parity or stop bit. garbled: whether there is such a one, or the sender lost power in the
    middle. sender: the drive, None for the master, its echo and foreign traffic. taken: how many characters the
    master's port has heard already. spoilt: the places of those that met another, as ranges. agreed: every receiver
    hears it as if the sender had the settings that it shares with this receiver. told_settings: those of its settings
    that a master has made known, by name. answer_due: whether a drive was about to answer, or answering, when a master
    handed it over.
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
    told_settings: Mapping[str, Any] = field(default_factory=dict)
    answer_due: bool = False

    def sound(self, first: int, last: int) -> bytes:
        """Return those of its characters from first up to last that did not collide."""
        if not self.spoilt:
            return self.data[first:last]
        return bytes(
            character
            for place, character in enumerate(self.data[first:last], first)
            if not any(begin <= place < end for begin, end in self.spoilt)
        )

    def out_by(self, now: float) -> int:
        """Return how many of its characters have been sent completely by then."""
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
    """All transmissions that can still collide with another one."""

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

    def is_answered(self, now: float) -> bool:
        """Return whether a drive is sending at this time."""
        return any(each.source == "drive" and each.began <= now < each.ended for each in self._present)

    def cut_off(self, sender: VirtualDrive, now: float) -> None:
        """Break off what this drive is sending."""
        for transmission in self._present:
            if transmission.sender is sender:
                transmission.cut_off(now)


class Receiver:
    """What the master's port has heard, and what it is hearing.

    agreed: by the identity of a drive, the settings that a master shares with it whose own ones are not known.
    """

    def __init__(self, agreed: Mapping[int, LineSettings]) -> None:
        self.settings: LineSettings | None = LineSettings()
        """The master's; None where they are not known."""
        self._agreed = agreed
        self._audible: list[Transmission] = []
        self._inbox = bytearray()

    @property
    def heard(self) -> int:
        """How many characters wait to be taken."""
        return len(self._inbox)

    @property
    def due(self) -> float:
        """When the next transmission has been heard whole; infinite if nothing is coming."""
        return min([sent.ended for sent in self._audible]) if self._audible else math.inf

    def add(self, sent: Transmission, now: float) -> None:
        """Hear a transmission that begins."""
        self._audible.append(sent)
        if len(self._audible) > _MOST_AUDIBLE:
            self.listen(now)

    def listen(self, now: float) -> None:
        """Move what has come by now into the inbox."""
        if not self._audible:
            return
        over = False
        for sent in self._audible:
            if sent.ended <= now:
                whole, over = len(sent.data), True
            elif sent.settings == self._ear_for(sent):
                whole = sent.out_by(now)
            else:
                # What other settings make of it shows in one piece.
                continue
            if whole > sent.taken:
                sound = sent.sound(sent.taken, whole)
                self._inbox += sound if sent.agreed else heard(sound, sent.settings, self._ear_for(sent))
                del self._inbox[_ROOM:]
                sent.taken = whole
        if over:
            self._audible = [sent for sent in self._audible if sent.ended > now]

    def take(self) -> bytes:
        """Return what has been heard."""
        data = bytes(self._inbox)
        self._inbox.clear()
        return data

    def ready_at(self, missing: int) -> float:
        """Return when so many more characters are there, or the next step towards it; never if nothing is coming."""
        # Of several that speak at once each character counts.
        step = missing if len(self._audible) == 1 else 1
        return min(
            (
                sent.end_of(sent.taken + step) if sent.settings == self._ear_for(sent) else sent.ended
                for sent in self._audible
            ),
            default=math.inf,
        )

    def _ear_for(self, sent: Transmission) -> LineSettings:
        """Return the settings with which the master hears this."""
        if self.settings is not None:
            return self.settings
        return sent.settings if sent.sender is None else self._agreed[id(sent.sender)]
