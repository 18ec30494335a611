"""A virtual drive that writes down what it hears, and can be looked at while another thread serves it."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from threading import RLock
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec, TypeVar

from drivecomm.errors import DriveCommError
from drivecomm.link import fields_text
from drivecomm.protocol import Framed, Telegram, is_for
from drivecomm.virtual import DriveProxy

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from drivecomm.protocol import Damaged, Protocol, VirtualDrive, VirtualReply
    from drivecomm.virtual import Violation

P = ParamSpec("P")
T = TypeVar("T")

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

    received: the sound telegrams that were for it, broadcasts included. damaged: what had the shape of a telegram and
    was none, whoever it was meant for. alone: held by whoever works with the drive, so that it can be looked at while
    another thread serves it.
    """

    def __init__(self) -> None:
        self.alone = RLock()
        self.received: deque[Received] = deque(maxlen=MOST_KEPT)
        self.damaged: deque[Damaged] = deque(maxlen=MOST_KEPT)


def _alone(act: Callable[Concatenate[RecordingDrive, P], T]) -> Callable[Concatenate[RecordingDrive, P], T]:
    def act_alone(drive: RecordingDrive, /, *arguments: P.args, **options: P.kwargs) -> T:
        with drive.record.alone:
            return act(drive, *arguments, **options)

    return act_alone


class RecordingDrive(DriveProxy):
    """Stands in place of a virtual drive and does what it does; what is for it is written down before."""

    def __init__(self, plugin: Protocol, drive: VirtualDrive, record: Record) -> None:
        super().__init__(drive)
        self._plugin = plugin
        self.record = record

    def hear(self, find: Framed | Damaged, now: float) -> VirtualReply | None:
        """Write down what is for the drive, and let it act."""
        with self.record.alone:
            if not isinstance(find, Framed):
                self.record.damaged.append(find)
            elif is_for(self._plugin, self.inner, find.message):
                name, message = self._plugin.name, find.message
                telegram = Telegram(protocol=name, direction="request", data=find.data, message=message)
                self.record.received.append(Received(time_s=now, telegram=telegram))
            return super().hear(find, now)

    peek = _alone(DriveProxy.peek)
    poke = _alone(DriveProxy.poke)
    trip = _alone(DriveProxy.trip)
    power_cycle = _alone(DriveProxy.power_cycle)
    follow = _alone(DriveProxy.follow)


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


def violation_list(found: Sequence[Violation]) -> str:
    """Return violations one a line, the latest ones if they are many."""
    left_out = len(found) - _MOST_LISTED
    head = [f"  ({left_out} earlier ones are left out)"] if left_out > 0 else []
    return "\n".join([*head, *(f"  {each.at_s:.4f}  {each}" for each in found[-_MOST_LISTED:])])


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


def held_form(another: VirtualDrive, parameter: str, raw: int | str) -> int | str:
    """Return what a drive shows that holds this raw value; the value itself where that cannot be tried out.

    A VABus drive holds eight hexadecimal characters, and the raw number is 1000: so another drive of the same sort is
    set to 1000 and shows what it then holds. It cannot be tried where the drive refuses the value, and where it does
    not heed it: what it measures cannot be set.
    """

    def after(value: int | str) -> int | str | None:
        try:
            another.poke(parameter, value)
            return another.peek(parameter, 0.0)
        except (DriveCommError, ValueError):
            return None

    before = another.peek(parameter, 0.0)
    shown = after(raw)
    if shown is None:
        return raw
    if shown != before:
        return shown
    # It held this before, or it does not heed what it is set to.
    others = (after(raw + step) for step in (1, -1)) if isinstance(raw, int) else ()
    return shown if any(other not in (None, shown) for other in others) else raw
