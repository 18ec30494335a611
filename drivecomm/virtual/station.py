"""A virtual drive on its line: its framer, its mains switch, bytes in, its replies out."""

from __future__ import annotations

from functools import lru_cache
from math import inf
from typing import TYPE_CHECKING, NamedTuple, Protocol, runtime_checkable

from drivecomm.protocol import Command, Framed, Framer, Noise
from drivecomm.virtual.uart import heard

if TYPE_CHECKING:
    from collections.abc import Collection, Hashable, Iterable
    from typing import TypeAlias

    from drivecomm.protocol import Find, LineSettings, VirtualDrive, VirtualReply

    # Telegrams, each with its address if it is valid and has one; between them noise for drives that take note of it.
    Telegrams: TypeAlias = list[tuple[Find, int | None]]
    # What is certain of bytes, and those of them that are pending.
    Known: TypeAlias = dict[bytes, tuple[Telegrams, bytes]]

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
    """A virtual drive that acts by itself, such as one with a watchdog."""

    def follow(self, now: float) -> None:
        """Let time pass."""
        ...


@runtime_checkable
class Overhears(Protocol):
    """A virtual drive that takes note of telegrams to other drives."""

    def overhear(self, now: float) -> None:
        """Take note of a valid telegram to another drive."""
        ...


@runtime_checkable
class Mishears(Protocol):
    """A virtual drive that takes note of characters that are no telegram to it, such as those of other protocols."""

    def mishear(self, now: float) -> None:
        """Take note of characters that are no telegram."""
        ...


@runtime_checkable
class PassesOver(Protocol):
    """A virtual drive that takes no notice of valid telegrams to others, beyond overhearing them.

    inner: the drive itself, that has the address and the settings. shared_addresses: those that are meant for others as
    well, such as that of all drives, or of a group. overhears: see `Overhears`.
    """

    inner: VirtualDrive
    address: int
    shared_addresses: Collection[int | None]
    overhears: bool

    def overhear(self, now: float) -> None:
        """Take note of a valid telegram to another drive."""
        ...


@runtime_checkable
class NeedsPause(Protocol):
    """A virtual drive that does not hear a request which begins sooner than this after its reply."""

    needs_pause_s: float


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
    was made. right_settings: those that it gets back after a power cut that changed them. deaf_until: when it hears
    again after its own reply. known: what has been made of bytes before, by drives that read alike.
    """

    def __init__(self, drive: VirtualDrive, known: Known | None = None) -> None:
        self.drive = drive
        self.powered = True
        self.pending = b""
        self.answering = 0
        self.answer: Answer | None = None
        self.wakes_at = inf
        self.agreed = one_of(drive.settings)
        self.right_settings: LineSettings | None = None
        self.deaf_until = 0.0
        self._needs_pause_s = drive.needs_pause_s if isinstance(drive, NeedsPause) else 0.0
        self._heard_at = 0.0
        self._passer = drive if isinstance(drive, PassesOver) else None
        self._mishearer = drive if isinstance(drive, Mishears) else None
        self.known: Known = {} if known is None else known
        self._settings, self._own = drive.settings, one_of(drive.settings)

    def received(self, data: bytes, spoken: LineSettings) -> bytes:
        """Return what the drive reads of characters that are sent with these settings, `one_of` their equals."""
        settings = self.drive.settings
        if settings is not self._settings:
            self._settings, self._own = settings, one_of(settings)
        return heard(data, spoken, self._own)

    def hear(self, data: bytes, began: float, ended: float) -> list[VirtualReply]:
        """Take bytes that were on the line between two times; return what the drive answers to them."""
        if began < self.deaf_until:
            return []
        telegrams = self._cut_short() if self.pending and began - self._heard_at > self.drive.gap_s else []
        self._heard_at = ended
        known = self.known.get(data) if not self.pending else None
        if known is None:
            known = self._telegrams(self.pending + data)
        more, self.pending = known
        answers, passer, mishearer = [], self._passer, self._mishearer
        for telegram, address in [*telegrams, *more] if telegrams else more:
            if isinstance(telegram, Noise):
                if mishearer is not None:
                    mishearer.mishear(ended)
            elif (
                passer is not None
                and address is not None
                and address != passer.address
                and address not in passer.shared_addresses
            ):
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
        ours = (None, passer.address, *passer.shared_addresses)
        return all(address not in ours for _, address in telegrams)

    def spoke(self, ended: float) -> None:
        """Take note of its own reply, which ends then."""
        self.deaf_until = ended + self._needs_pause_s

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

    def _telegrams(self, data: bytes) -> tuple[Telegrams, bytes]:
        """Return the complete telegrams of these bytes, and the rest, which is pending."""
        known = self.known.get(data)
        if known is None:
            finds = Framer(self.drive.codec, "request").feed(data)
            # A damaged telegram is looked at again byte by byte, so its bytes are among the others.
            done = sum(len(find.data) for find in finds if isinstance(find, Framed | Noise))
            known = self._addressed(finds), data[done:]
            if len(self.known) >= _MOST_KNOWN:
                self.known.clear()
            if len(data) <= _LONGEST_KNOWN:
                self.known[data] = known
        return known

    def _cut_short(self) -> Telegrams:
        """Return what the pending bytes amount to, now that nothing follows them."""
        framer = Framer(self.drive.codec, "request")
        finds = [*framer.feed(self.pending), *framer.flush()]
        self.pending = b""
        return self._addressed(finds)

    def _addressed(self, finds: list[Find]) -> Telegrams:
        return [
            (find, getattr(find.message, "address", None) if isinstance(find, Framed) else None)
            for find in finds
            if self._mishearer is not None or not isinstance(find, Noise)
        ]


@lru_cache(maxsize=256)
def one_of(settings: LineSettings) -> LineSettings:
    """Return always the same of equal settings, so that comparing them costs nothing."""
    return settings


def stations_of(drives: Iterable[VirtualDrive]) -> list[Station]:
    """Return a station for each drive of a line.

    A codec may have an attribute `alike`, anything hashable: those with equal ones make the same of the same bytes, so
    that it is found out once for all of their drives.
    """
    known: dict[Hashable, Known] = {}
    return [Station(drive, known.setdefault(getattr(drive.codec, "alike", id(drive)), {})) for drive in drives]
