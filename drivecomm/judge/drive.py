"""The virtual drive that a judged master talks to: all that it heard and did, and a hand in what it answers."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from threading import RLock
from typing import TYPE_CHECKING

from drivecomm.protocol import Command, Framed, Refuses, fields_of, is_for
from drivecomm.virtual import DriveProxy

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable

    from drivecomm.protocol import Damaged, Message, Protocol, VirtualDrive, VirtualReply
    from drivecomm.virtual import LineRules

MOST_HEARD = 20_000
BEFORE_S = 1000.0
"""How long the drive has had mains when its line begins, in seconds: whatever was prepared is over by then."""

_SERIAL_NUMBERS = ("transaction",)
"""Fields that differ from telegram to telegram, whatever they ask."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Heard:
    """A sound request to the drive.

    time_s: when its last character was there. key: the same for requests that ask the same. reply: what the drive
    answered, before anything was done to that. started: whether it made the motor run; stopped: whether it ended that.
    """

    time_s: float
    find: Framed
    key: Hashable
    reply: bytes | None
    started: bool
    stopped: bool

    @property
    def data(self) -> bytes:
        """The bytes of the request."""
        return self.find.data


def key_of(message: Message) -> Hashable:
    """Return what is the same for all requests that ask or command the same."""
    fields = fields_of(message)
    return tuple((name, str(value)) for name, value in sorted(fields.items()) if name not in _SERIAL_NUMBERS)


class JudgedDrive(DriveProxy):
    """Stands in front of a virtual drive. All of it may be looked at while another thread serves its line.

    rules: what its master has to keep to on the line.
    heard: the sound requests that were for this drive, in order, the last 20 000. refused_with: codes that it was told
    to refuse with. states: of its motor. between: called for each request with it and what lets the drive act; returns
    the reply.
    """

    def __init__(self, plugin: Protocol, drive: VirtualDrive, rules: LineRules) -> None:
        super().__init__(drive)
        self.rules = rules
        self.alone = RLock()
        self.heard: deque[Heard] = deque(maxlen=MOST_HEARD)
        self.damaged = 0
        self.refused_with: set[int] = set()
        self.states: set[str] = set()
        self.between: Callable[[Framed, Callable[[], VirtualReply | None]], VirtualReply | None] = lambda _, act: act()
        self._plugin = plugin

    def time_of(self, now: float) -> float:
        """Return the time of the drive, which has had mains for a while."""
        return now + BEFORE_S

    def hear(self, find: Framed | Damaged, now: float) -> VirtualReply | None:
        """Let the drive act, and note what it heard and did."""
        with self.alone:
            if not isinstance(find, Framed):
                self.damaged += 1
                return super().hear(find, now)
            if not is_for(self._plugin, self.inner, find.message):
                return super().hear(find, now)
            self.follow(now)
            self.motor.advance(self.time_of(now))
            before = self.motor.command
            reply = self.between(find, lambda: super(JudgedDrive, self).hear(find, now))
            after = self.motor.command
            self.states |= {before.value, after.value} | ({"fault"} if self.motor.fault else set())
            ran, runs = before is Command.RUN, after is Command.RUN
            self.heard.append(
                Heard(
                    time_s=now,
                    find=find,
                    key=key_of(find.message),
                    reply=None if reply is None else reply.data,
                    started=runs and not ran,
                    stopped=ran and not runs,
                )
            )
            return reply

    def refuse(self, find: Framed, code: int, now: float) -> VirtualReply | None:
        """Refuse a request with a code; None for one that no drive of the protocol refuses."""
        inner = self.inner
        reply = inner.refusing(find, code, self.time_of(now)) if isinstance(inner, Refuses) else None
        if reply is not None:
            self.refused_with.add(code)
        return reply

    def since(self, number: int = 0) -> list[Heard]:
        """Return the requests from a number on."""
        with self.alone:
            return list(self.heard)[number:]

    def answered(self, reply: bytes) -> Heard | None:
        """Return the latest request that was answered with these bytes."""
        return next((each for each in reversed(self.since()) if each.reply == reply), None)

    def power_cycle(self, now: float) -> None:
        """Switch mains off and on."""
        with self.alone:
            # What a power cut did to the motor was told in the time of the line.
            self.motor.stop(Command.OFF, self.time_of(now))
            super().power_cycle(now)
