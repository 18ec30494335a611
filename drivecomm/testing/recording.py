"""A virtual drive that writes down what it hears, and can be looked at while another thread serves it."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from threading import RLock
from typing import TYPE_CHECKING, Any

from drivecomm.link import fields_text
from drivecomm.protocol import Framed, Telegram
from drivecomm.virtual import DriveProxy

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from drivecomm.protocol import Damaged, Message, Protocol, VirtualDrive, VirtualReply

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
        """Forget all of it."""
        with self.alone:
            self._received.clear()
            self._damaged.clear()


class RecordingDrive(DriveProxy):
    """Stands in place of a virtual drive and does what it does; what is for it is written down before."""

    def __init__(self, plugin: Protocol, drive: VirtualDrive, record: Record) -> None:
        super().__init__(drive)
        self._plugin = plugin
        self._record = record
        self._alone = record.alone

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
            return super().hear(find, now)

    def peek(self, parameter: str, now: float) -> int | str:
        """Return what it holds. Raises ParameterAddressError."""
        with self._alone:
            return super().peek(parameter, now)

    def poke(self, parameter: str, raw: int | str) -> None:
        """Set what it holds. Raises ParameterAddressError."""
        with self._alone:
            super().poke(parameter, raw)

    def trip(self, code: int, now: float) -> None:
        """Make it trip."""
        with self._alone:
            super().trip(code, now)

    def power_cycle(self, now: float) -> None:
        """Switch its mains off and on, if it forgets anything by that."""
        with self._alone:
            super().power_cycle(now)

    def follow(self, now: float) -> None:
        """Let it do what it does by itself."""
        with self._alone:
            super().follow(now)

    def _is_meant(self, message: Message) -> bool:
        if getattr(message, "broadcast", False) is True:
            return True
        address = getattr(message, "address", None)
        return address is not None and address in (self.address, self._plugin.broadcast_address)


_MOST_LISTED = 10
_ABSENT = object()


def matches(received: Received, wanted: Mapping[str, Any]) -> bool:
    """Return whether a telegram has these fields with these values."""
    return not _differing(received, wanted)


def closest(received: Sequence[Received], wanted: Mapping[str, Any]) -> str:
    """Return the latest of those telegrams that differ in the fewest fields, and in which."""
    nearest = min(reversed(received), key=lambda each: len(_differing(each, wanted)))
    fields = nearest.fields
    reasons = [
        f"{name} is {fields[name]!r}, not {wanted[name]!r}" if name in fields else f"it has no {name}"
        for name in _differing(nearest, wanted)
    ]
    return f"{fields_text(nearest.telegram.message)} ({'; '.join(reasons)})"


def listing(received: Sequence[Received]) -> str:
    """Return telegrams one a line, the latest ones if they are many."""
    left_out = len(received) - _MOST_LISTED
    head = [f"  ({left_out} earlier ones are left out)"] if left_out > 0 else []
    shown = [f"  {each.time_s:.4f}  {fields_text(each.telegram.message)}" for each in received[-_MOST_LISTED:]]
    return "\n".join([*head, *shown])


def in_words(number: int, wanted: Mapping[str, Any]) -> str:
    """Return how many telegrams of which sort, in words."""
    fields = [f"{name}={value!r}" for name, value in wanted.items() if name != "kind"]
    sort = f"{wanted['kind']} telegram" if "kind" in wanted else "telegram"
    counted = f"no {sort}" if not number else f"{number} {sort}{'s' if number != 1 else ''}"
    return f"{counted} with {', '.join(fields)}" if fields else counted


def _differing(received: Received, wanted: Mapping[str, Any]) -> list[str]:
    fields, message = received.fields, received.telegram.message
    return [
        name
        for name, value in wanted.items()
        # A field that is a tuple or a decimal in Python is a list or a text where it is written down; both will do.
        if fields.get(name, _ABSENT) != value and (name not in fields or getattr(message, name, _ABSENT) != value)
    ]
