"""A virtual drive's place on a line: its ear, its mains switch, bytes in, its replies out."""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING, NamedTuple, Protocol, TypeAlias, runtime_checkable

from drivecomm.protocol import Command, Framed, Framer, Noise

if TYPE_CHECKING:
    from drivecomm.protocol import Damaged, Find, LineSettings, VirtualDrive, VirtualReply

_Telegrams: TypeAlias = "list[tuple[Framed | Damaged, int | None]]"
"""Telegrams, each with its address if it is sound and has one."""

# What a drive has heard before is not looked at again: so many pieces, none longer than this.
_MOST_KNOWN = 512
_LONGEST_KNOWN = 300


@runtime_checkable
class Restarts(Protocol):
    """A virtual drive that can forget what a real one forgets without power."""

    def power_cycle(self, now: float) -> None:
        """Switch mains off and on."""
        ...


@runtime_checkable
class Follows(Protocol):
    """A virtual drive that does something by itself, such as noticing that nobody speaks to it any more."""

    def follow(self, now: float) -> None:
        """Let time pass."""
        ...


@runtime_checkable
class Overhears(Protocol):
    """A virtual drive to which it matters that others on its line are spoken to."""

    def overhear(self, now: float) -> None:
        """Take note of a sound telegram to another drive."""
        ...


@runtime_checkable
class PassesOver(Protocol):
    """A virtual drive that takes no notice of sound telegrams to others, beyond overhearing them.

    inner: the drive itself, that has the address and the settings. broadcast_address: the one that is meant for all;
    None where a protocol has none. overhears: see `Overhears`.
    """

    inner: VirtualDrive
    address: int
    broadcast_address: int | None
    overhears: bool

    def overhear(self, now: float) -> None:
        """Take note of a sound telegram to another drive."""
        ...


class Answer(NamedTuple):
    """What a drive will say, and when. number: see `Station.answering`."""

    time: float
    data: bytes
    number: int


class Station:
    """Feeds one virtual drive with everything that is heard on its line, replies of other drives included.

    powered: a drive without power neither hears nor answers. pending: what has been heard of a telegram that is not
    whole. answering: the number of the answer that the drive has in mind; an answer with a lower number is dropped.
    answer: that answer; wakes_at: when the line comes back to it. agreed: the settings that the drive had when the line
    was made. right_settings: those that it gets back after a power cut that changed them.
    """

    def __init__(self, drive: VirtualDrive) -> None:
        self.drive = drive
        self.powered = True
        self.pending = b""
        self.answering = 0
        self.answer: Answer | None = None
        self.wakes_at = inf
        self.agreed = drive.settings
        self.right_settings: LineSettings | None = None
        self._heard_at = 0.0
        self._passer = drive if isinstance(drive, PassesOver) else None
        self._known: dict[bytes, tuple[_Telegrams, bytes]] = {}

    def hear(self, data: bytes, began: float, ended: float) -> list[VirtualReply]:
        """Take bytes that were on the line between two times; return what the drive answers to them."""
        telegrams = self._cut_short() if self.pending and began - self._heard_at > self.drive.gap_s else []
        self._heard_at = ended
        known = self._known.get(data) if not self.pending else None
        if known is None:
            known = self._telegrams(self.pending + data)
        more, self.pending = known
        answers, passer = [], self._passer
        for telegram, address in [*telegrams, *more] if telegrams else more:
            if passer is not None and address is not None and address not in (passer.address, passer.broadcast_address):
                if passer.overhears:
                    passer.overhear(ended)
            elif (answer := self.drive.hear(telegram, ended)) is not None:
                answers.append(answer)
        return answers

    def passes_over(self, data: bytes) -> bool:
        """Whether these bytes, heard behind nothing else, are whole telegrams of which the drive takes no notice."""
        telegrams, rest = self._telegrams(data)
        passer = self._passer
        if rest or passer is None or (passer.overhears and telegrams):
            return False
        ours = (None, passer.address, passer.broadcast_address)
        return all(address not in ours for _, address in telegrams)

    def power_off(self, now: float) -> None:
        """Take its power away: the motor coasts, and what is half heard or not yet answered is forgotten."""
        self.powered = False
        self.pending = b""
        self.answering += 1
        self.drive.motor.stop(Command.OFF, now)

    def power_on(self, now: float) -> None:
        """Give it power; it starts as new as its virtual drive can, and keeps its parameters."""
        self.powered = True
        if isinstance(self.drive, Restarts):
            self.drive.power_cycle(now)

    def set_right(self) -> None:
        """Give the drive its line settings back."""
        self.drive.settings, self.right_settings = self.right_settings or self.drive.settings, None

    def _telegrams(self, data: bytes) -> tuple[_Telegrams, bytes]:
        """Return what is certain of these bytes, and the rest, which is pending."""
        known = self._known.get(data)
        if known is None:
            finds = Framer(self.drive.codec, "request").feed(data)
            # A damaged telegram is looked at again byte by byte, so its bytes are among the others.
            done = sum(len(find.data) for find in finds if isinstance(find, Framed | Noise))
            known = self._addressed(finds), data[done:]
            if len(self._known) >= _MOST_KNOWN:
                self._known.clear()
            if len(data) <= _LONGEST_KNOWN:
                self._known[data] = known
        return known

    def _cut_short(self) -> _Telegrams:
        """Return what the pending bytes amount to, now that nothing follows them."""
        framer = Framer(self.drive.codec, "request")
        finds = [*framer.feed(self.pending), *framer.flush()]
        self.pending = b""
        return self._addressed(finds)

    def _addressed(self, finds: list[Find]) -> _Telegrams:
        return [
            (find, getattr(find.message, "address", None) if isinstance(find, Framed) else None)
            for find in finds
            if not isinstance(find, Noise)
        ]
