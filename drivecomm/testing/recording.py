"""Recording virtual drive: stores the telegrams it receives, and can be inspected while another thread serves it."""

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
"""Limit of stored telegrams; a test of a million exchanges must not fill the memory."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Received:
    """A valid telegram for a drive, and the end of its last character in seconds of the line's clock."""

    time_s: float
    telegram: Telegram

    @property
    def kind(self) -> str:
        """Kind of the telegram in its protocol."""
        return self.telegram.kind

    @property
    def fields(self) -> dict[str, Any]:
        """Decoded fields by name."""
        return self.telegram.fields

    @property
    def data(self) -> bytes:
        """Bytes of the telegram."""
        return self.telegram.data


class Record:
    """Telegrams that one drive has received; of each kind, the last 50 000 are stored.

    received: valid telegrams for the drive, including broadcasts. damaged: invalid telegrams on the line, for any
    drive. alone: lock that is held during every access to the drive, so that a test can inspect it while another thread
    serves it.
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
    """Wrapper of a virtual drive that records each telegram before the drive acts on it."""

    def __init__(self, plugin: Protocol, drive: VirtualDrive, record: Record) -> None:
        super().__init__(drive)
        self._plugin = plugin
        self.record = record

    def hear(self, find: Framed | Damaged, now: float) -> VirtualReply | None:
        """Record a telegram if it is for this drive, and pass it on to the drive."""
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


def closest_telegram_text(received: Sequence[Received], wanted: Mapping[str, Any]) -> str:
    """Describe the latest of the telegrams that differ in the fewest fields, with the differences."""
    nearest = min(reversed(received), key=lambda each: len(_differing(each, wanted)))
    fields = nearest.fields
    reasons = [
        f"{name} is {fields[name]!r}, not {wanted[name]!r}" if name in fields else f"it has no {name}"
        for name in _differing(nearest, wanted)
    ]
    return f"{fields_text(nearest.telegram.message)} ({'; '.join(reasons)})"


def telegram_list(received: Sequence[Received]) -> str:
    """Return a list of telegrams, one a line; only the latest ones if there are many."""
    left_out = len(received) - _MOST_LISTED
    head = [f"  ({left_out} earlier ones are left out)"] if left_out > 0 else []
    shown = [f"  {each.time_s:.4f}  {fields_text(each.telegram.message)}" for each in received[-_MOST_LISTED:]]
    return "\n".join([*head, *shown])


def violation_list(found: Sequence[Violation]) -> str:
    """Return a list of violations, one a line; only the latest ones if there are many."""
    left_out = len(found) - _MOST_LISTED
    head = [f"  ({left_out} earlier ones are left out)"] if left_out > 0 else []
    return "\n".join([*head, *(f"  {each.at_s:.4f}  {each}" for each in found[-_MOST_LISTED:])])


def telegram_count_text(number: int, wanted: Mapping[str, Any]) -> str:
    """Return a number of telegrams with these fields in words."""
    fields = [f"{name}={value!r}" for name, value in wanted.items() if name != "kind"]
    sort = f"{wanted['kind']} telegram" if "kind" in wanted else "telegram"
    counted = f"no {sort}" if not number else f"{number} {sort}{'s' if number != 1 else ''}"
    return f"{counted} with {', '.join(fields)}" if fields else counted


def _differing(received: Received, wanted: Mapping[str, Any]) -> list[str]:
    fields, message = received.fields, received.telegram.message
    return [
        name
        for name, value in wanted.items()
        # A tuple or Decimal in Python is written as a list or text in a test; accept both.
        if fields.get(name, _ABSENT) != value and (name not in fields or getattr(message, name, _ABSENT) != value)
    ]


def held_form(another: VirtualDrive, parameter: str, raw: int | str) -> int | str:
    """Return a raw value in the form in which the drive shows it; the value itself if that cannot be tried.

    A VABus drive shows eight hexadecimal characters for the raw number 1000. So another drive of the same kind is set
    to 1000, and what it shows is returned. That is impossible if the drive refuses the value, or ignores it as it does
    for measured values.
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
    # Either the parameter had this value before, or the drive ignores what is set.
    others = (after(raw + step) for step in (1, -1)) if isinstance(raw, int) else ()
    return shown if any(other not in (None, shown) for other in others) else raw
