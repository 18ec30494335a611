"""The wire: the transmissions on it, and the effect of their collisions."""

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

# Times are sums of floats, so a character counts as sent if only a thousandth of it is missing.
_TOLERANCE = 1e-3
# Bytes that the master does not read are lost beyond this limit, as in the buffer of a port.
_ROOM = 65536
_MOST_AUDIBLE = 256


@dataclass(slots=True, kw_only=True, eq=False)
class Transmission:
    """Characters on the wire from `began` until `ended`, in seconds of the line's clock.

    data: characters as they are on the wire; a collided one is shown as NUL and heard by no receiver, because receivers
    drop characters with a wrong parity or stop bit. garbled: whether a character collided, or the sender lost power in
    the middle. sender: the drive; None for the master, its echo and foreign traffic. taken: number of characters that
    the master's port has already heard. spoilt: positions of the collided characters, as ranges. agreed: True if every
    receiver hears the characters with the settings that it shares with the sender. told_settings: the known line
    settings of a master, by name. answer_due: whether a drive was answering, or about to, when the master handed over
    its data.
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
        """Return the characters from `first` up to `last` that did not collide."""
        if not self.spoilt:
            return self.data[first:last]
        return bytes(
            character
            for place, character in enumerate(self.data[first:last], first)
            if not any(begin <= place < end for begin, end in self.spoilt)
        )

    def out_by(self, now: float) -> int:
        """Return the number of characters that have been sent completely by this time."""
        if now >= self.ended:
            return len(self.data)
        return min(len(self.data), int((now - self.began) / self.settings.character_s + _TOLERANCE))

    def end_of(self, number: int) -> float:
        """Return the time at which this number of characters has been sent, or all of them if there are fewer."""
        return self.ended if number >= len(self.data) else self.began + number * self.settings.character_s

    def cut_off(self, now: float) -> None:
        """Break off the transmission at this time."""
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
    """All transmissions that can still collide with another."""

    def __init__(self) -> None:
        self._present: list[Transmission] = []

    def begin(self, new: Transmission) -> None:
        """Put a transmission on the wire, not earlier than any before; characters that overlap are spoilt.

        An echo comes from the master's own adapter. It does not occupy the wire, but other transmissions spoil it.
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
        """Break off the present transmission of this drive."""
        for transmission in self._present:
            if transmission.sender is sender:
                transmission.cut_off(now)


class MasterReceiver:
    """The receiving side of the master's port.

    agreed: settings that the master shares with each drive, by the drive's `id`, for a master with unknown settings.
    """

    def __init__(self, agreed: Mapping[int, LineSettings]) -> None:
        self.settings: LineSettings | None = LineSettings()
        """Line settings of the master; None if unknown."""
        self._agreed = agreed
        self._audible: list[Transmission] = []
        self._inbox = bytearray()

    @property
    def heard(self) -> int:
        """Number of characters that wait to be taken."""
        return len(self._inbox)

    @property
    def due(self) -> float:
        """Time at which the next transmission is complete; infinite if there is none."""
        return min([sent.ended for sent in self._audible]) if self._audible else math.inf

    def add(self, sent: Transmission, now: float) -> None:
        """Begin to hear a transmission."""
        self._audible.append(sent)
        if len(self._audible) > _MOST_AUDIBLE:
            self.listen(now)

    def listen(self, now: float) -> None:
        """Move the characters heard by this time into the inbox."""
        if not self._audible:
            return
        over = False
        for sent in self._audible:
            if sent.ended <= now:
                whole, over = len(sent.data), True
            elif sent.settings == self._ear_for(sent):
                whole = sent.out_by(now)
            else:
                # Characters with other settings can only be converted once the transmission is complete.
                continue
            if whole > sent.taken:
                sound = sent.sound(sent.taken, whole)
                self._inbox += sound if sent.agreed else heard(sound, sent.settings, self._ear_for(sent))
                del self._inbox[_ROOM:]
                sent.taken = whole
        if over:
            self._audible = [sent for sent in self._audible if sent.ended > now]

    def take(self) -> bytes:
        """Return the characters heard, and empty the inbox."""
        data = bytes(self._inbox)
        self._inbox.clear()
        return data

    def ready_at(self, missing: int) -> float:
        """Return the time at which up to `missing` more characters will have arrived; infinity if none will."""
        # With several senders at the same time each character must be checked.
        step = missing if len(self._audible) == 1 else 1
        return min(
            (
                sent.end_of(sent.taken + step) if sent.settings == self._ear_for(sent) else sent.ended
                for sent in self._audible
            ),
            default=math.inf,
        )

    def _ear_for(self, sent: Transmission) -> LineSettings:
        """Return the settings with which the master hears this transmission."""
        if self.settings is not None:
            return self.settings
        return sent.settings if sent.sender is None else self._agreed[id(sent.sender)]
