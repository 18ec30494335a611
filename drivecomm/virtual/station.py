"""A virtual drive on its line: its framer and mains switch, the bytes that it hears and its replies."""

from __future__ import annotations

from functools import lru_cache
from math import inf
from typing import TYPE_CHECKING, NamedTuple, Protocol, runtime_checkable

from drivecomm.protocol import Framed, Framer, MotorCommand, Noise
from drivecomm.virtual.uart import heard

if TYPE_CHECKING:
    from collections.abc import Collection, Hashable, Iterable
    from typing import TypeAlias

    from drivecomm.protocol import Find, LineSettings, VirtualDrive, VirtualReply

    # Telegrams, each with its address if it is valid and has one, and the noise between them for drives that use it.
    Telegrams: TypeAlias = list[tuple[Find, int | None]]
    # For each piece of bytes: its telegrams, and the bytes of an incomplete one at its end.
    Known: TypeAlias = dict[bytes, tuple[Telegrams, bytes]]

# Number of pieces in the cache, and the length up to which a piece is cached.
_MOST_KNOWN = 512
_LONGEST_KNOWN = 300


@runtime_checkable
class Restarts(Protocol):
    """A virtual drive that can lose the state that a real one loses without power."""

    def power_cycle(self, now: float) -> None:
        """Switch the mains off and on."""
        ...


@runtime_checkable
class Follows(Protocol):
    """A virtual drive that acts by itself, such as one with a watchdog."""

    def follow(self, now: float) -> None:
        """Act on the time that has passed."""
        ...


@runtime_checkable
class Overhears(Protocol):
    """A virtual drive that uses telegrams to other drives."""

    def overhear(self, now: float) -> None:
        """Record a valid telegram to another drive."""
        ...


@runtime_checkable
class Mishears(Protocol):
    """A virtual drive that uses characters which are not a telegram to it, such as those of other protocols."""

    def mishear(self, now: float) -> None:
        """Record characters that are not a telegram."""
        ...


@runtime_checkable
class IgnoresOthers(Protocol):
    """A virtual drive that ignores valid telegrams to others, except for overhearing them.

    inner: the drive itself, with its address and settings. shared_addresses: addresses that it shares with others, such
    as those of all drives or of a group. overhears: see `Overhears`.
    """

    inner: VirtualDrive
    address: int
    shared_addresses: Collection[int | None]
    overhears: bool

    def overhear(self, now: float) -> None:
        """Record a valid telegram to another drive."""
        ...


@runtime_checkable
class NeedsPause(Protocol):
    """A virtual drive that misses a request which begins sooner than this many seconds after its reply."""

    needs_pause_s: float


class PendingAnswer(NamedTuple):
    """A future answer of a drive, and its time. number: see `Station.answering`."""

    time: float
    data: bytes
    number: int


class Station:
    """A virtual drive on its line, which receives everything on the line, replies of other drives included.

    powered: a drive without power neither receives nor answers. pending: bytes of an incomplete telegram. answering:
    number of the answer that the drive prepares; an answer with a lower number is dropped. answer: that answer.
    wakes_at: time at which the line handles it. agreed: settings of the drive when the line was made. right_settings:
    settings to restore after a power cut that changed them. deaf_until: time until which the drive hears nothing after
    its own reply. known: cache of decoded bytes, shared by drives that decode alike.
    """

    def __init__(self, drive: VirtualDrive, known: Known | None = None) -> None:
        self.drive = drive
        self.powered = True
        self.pending = b""
        self.answering = 0
        self.answer: PendingAnswer | None = None
        self.wakes_at = inf
        self.agreed = shared_settings(drive.settings)
        self.right_settings: LineSettings | None = None
        self.deaf_until = 0.0
        self._needs_pause_s = drive.needs_pause_s if isinstance(drive, NeedsPause) else 0.0
        self._heard_at = 0.0
        self._passer = drive if isinstance(drive, IgnoresOthers) else None
        self._mishearer = drive if isinstance(drive, Mishears) else None
        self.known: Known = {} if known is None else known
        self._settings, self._own = drive.settings, shared_settings(drive.settings)

    def received(self, data: bytes, spoken: LineSettings) -> bytes:
        """Return the characters that the drive receives. spoken: settings of the sender, see `shared_settings`."""
        settings = self.drive.settings
        if settings is not self._settings:
            self._settings, self._own = settings, shared_settings(settings)
        return heard(data, spoken, self._own)

    def hear(self, data: bytes, began: float, ended: float) -> list[VirtualReply]:
        """Process bytes that were on the line between two times; return the drive's answers."""
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
        """Whether these bytes, heard on their own, are whole telegrams that the drive ignores."""
        telegrams, rest = self._telegrams(data)
        passer = self._passer
        if rest or passer is None or (passer.overhears and telegrams):
            return False
        ours = (None, passer.address, *passer.shared_addresses)
        return all(address not in ours for _, address in telegrams)

    def spoke(self, ended: float) -> None:
        """Record the end of the drive's own reply."""
        self.deaf_until = ended + self._needs_pause_s

    def power_off(self, now: float) -> None:
        """Switch the power off: the motor coasts, and incomplete telegrams and pending answers are dropped."""
        self.powered = False
        self.pending = b""
        self.answering += 1
        self.drive.motor.stop(MotorCommand.OFF, now)

    def power_on(self, now: float) -> None:
        """Switch the power on; parameters are kept, other state is reset if the drive supports this."""
        self.powered = True
        if isinstance(self.drive, Restarts):
            self.drive.power_cycle(now)

    def set_right(self) -> None:
        """Restore the drive's line settings."""
        self.drive.settings, self.right_settings = self.right_settings or self.drive.settings, None

    def _telegrams(self, data: bytes) -> tuple[Telegrams, bytes]:
        """Return the complete telegrams of these bytes, and the bytes of an incomplete one."""
        known = self.known.get(data)
        if known is None:
            finds = Framer(self.drive.codec, "request").feed(data)
            # The bytes of a damaged telegram are decoded again one by one, so the other finds include them.
            done = sum(len(find.data) for find in finds if isinstance(find, Framed | Noise))
            known = self._addressed(finds), data[done:]
            if len(self.known) >= _MOST_KNOWN:
                self.known.clear()
            if len(data) <= _LONGEST_KNOWN:
                self.known[data] = known
        return known

    def _cut_short(self) -> Telegrams:
        """Return the finds in the pending bytes, now that the telegram has been broken off."""
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
def shared_settings(settings: LineSettings) -> LineSettings:
    """Return the same object for equal settings, so that comparing them is fast."""
    return settings


def stations_of(drives: Iterable[VirtualDrive]) -> list[Station]:
    """Return a station for each drive of a line.

    A codec may have a hashable attribute `alike`: codecs with equal values decode the same bytes alike, so that one
    result serves all of their drives.
    """
    known: dict[Hashable, Known] = {}
    return [Station(drive, known.setdefault(getattr(drive.codec, "alike", id(drive)), {})) for drive in drives]
