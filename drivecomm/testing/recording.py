"""A virtual drive that writes down what it hears, and can be looked at while another thread serves it."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from threading import RLock
from typing import TYPE_CHECKING, Any

from drivecomm.protocol import Framed, LineSettings, Motor, Telegram
from drivecomm.virtual import OfDrive

if TYPE_CHECKING:
    from drivecomm.protocol import Codec, Damaged, Message, Protocol, VirtualDrive, VirtualReply

MOST_KEPT = 50_000
"""How many telegrams are kept; a test of a million exchanges must not fill the memory with them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Received:
    """A sound telegram for a drive, and when its last character was there, in seconds of the line's clock."""

    time_s: float
    telegram: Telegram

    @property
    def kind(self) -> str:
        """Which of the protocol's telegrams it is."""
        return self.telegram.kind

    @property
    def fields(self) -> dict[str, Any]:
        """Its decoded fields by name."""
        return self.telegram.fields

    @property
    def data(self) -> bytes:
        """Its bytes."""
        return self.telegram.data


class Record:
    """What one drive has heard; of all, the last 50 000 are kept.

    alone: held by whoever works with the drive, so that it can be looked at while another thread serves it.
    """

    def __init__(self) -> None:
        self.alone = RLock()
        self._received: deque[Received] = deque(maxlen=MOST_KEPT)
        self._damaged: deque[Damaged] = deque(maxlen=MOST_KEPT)

    def add(self, find: Received | Damaged) -> None:
        """Write down a telegram that was for the drive, or one that was damaged."""
        with self.alone:
            if isinstance(find, Received):
                self._received.append(find)
            else:
                self._damaged.append(find)

    def received(self) -> tuple[Received, ...]:
        """Return the sound telegrams that were for the drive, broadcasts included."""
        with self.alone:
            return tuple(self._received)

    def damaged(self) -> tuple[Damaged, ...]:
        """Return what had the shape of a telegram and was none, whoever it was meant for."""
        with self.alone:
            return tuple(self._damaged)

    def forget(self) -> None:
        """Begin anew."""
        with self.alone:
            self._received.clear()
            self._damaged.clear()


class RecordingDrive:
    """Stands in place of a virtual drive and does what it does; what is for it is written down before."""

    address = OfDrive[int]()
    settings = OfDrive[LineSettings]()
    gap_s = OfDrive[float]()
    motor = OfDrive[Motor]()

    def __init__(self, plugin: Protocol, drive: VirtualDrive, record: Record) -> None:
        self._plugin = plugin
        self.inner = drive
        self._record = record
        self._alone = record.alone

    @property
    def codec(self) -> Codec:
        """The telegrams that it understands."""
        return self.inner.codec

    def hear(self, find: Framed | Damaged, now: float) -> VirtualReply | None:
        """Write down what is for the drive, and let it act."""
        with self._alone:
            if not isinstance(find, Framed):
                self._record.add(find)
            elif self._is_meant(find.message):
                telegram = Telegram(
                    protocol=self._plugin.name, direction="request", data=find.data, message=find.message
                )
                self._record.add(Received(time_s=now, telegram=telegram))
            return self.inner.hear(find, now)

    def peek(self, parameter: str, now: float) -> int | str:
        """Return what it holds. Raises ParameterAddressError."""
        with self._alone:
            return self.inner.peek(parameter, now)

    def poke(self, parameter: str, raw: int | str) -> None:
        """Set what it holds. Raises ParameterAddressError."""
        with self._alone:
            self.inner.poke(parameter, raw)

    def trip(self, code: int, now: float) -> None:
        """Make it trip."""
        with self._alone:
            self.inner.trip(code, now)

    def power_cycle(self, now: float) -> None:
        """Switch its mains off and on, if it forgets anything by that."""
        with self._alone:
            restart = getattr(self.inner, "power_cycle", None)
            if restart is not None:
                restart(now)

    def _is_meant(self, message: Message) -> bool:
        if getattr(message, "broadcast", False) is True:
            return True
        address = getattr(message, "address", None)
        return address is not None and address in (self.address, self._plugin.broadcast_address)
