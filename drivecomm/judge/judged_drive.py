"""Virtual drive for judging a master: records its requests and effects, and can alter its replies."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from threading import RLock
from typing import TYPE_CHECKING

from drivecomm.protocol import Framed, MotorCommand, Refuses, fields_of, is_for
from drivecomm.virtual import DriveProxy

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable

    from drivecomm.protocol import Damaged, Message, Protocol, VirtualDrive, VirtualReply
    from drivecomm.virtual import LineRules

MOST_HEARD = 20_000
BEFORE_S = 1000.0
"""Seconds for which the drive has had mains when its line begins; all preparation is finished by then."""

_SERIAL_NUMBERS = ("transaction",)
"""Fields that differ from telegram to telegram with the same content."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ObservedRequest:
    """A valid request to the drive.

    time_s: end of its last character. key: equal for requests with the same content. reply: the drive's reply before
    any disturbance. started: whether it started the motor. stopped: whether it stopped the motor.
    """

    time_s: float
    find: Framed
    key: Hashable
    reply: bytes | None
    started: bool
    stopped: bool

    @property
    def data(self) -> bytes:
        """Bytes of the request."""
        return self.find.data


def key_of(message: Message) -> Hashable:
    """Return a key that is equal for all requests with the same content."""
    fields = fields_of(message)
    return tuple((name, str(value)) for name, value in sorted(fields.items()) if name not in _SERIAL_NUMBERS)


class JudgedDrive(DriveProxy):
    """Wrapper of a virtual drive that records requests; it can be inspected while another thread serves its line.

    rules: the rules for its master on the line. heard: the valid requests for this drive, in order, the last 20 000.
    refused_with: the codes of its refusals. states: the states that its motor has had. between: called for each request
    with the request and a function that makes the drive act; returns the reply.
    """

    def __init__(self, plugin: Protocol, drive: VirtualDrive, rules: LineRules) -> None:
        super().__init__(drive)
        self.rules = rules
        self.alone = RLock()
        self.heard: deque[ObservedRequest] = deque(maxlen=MOST_HEARD)
        self.damaged = 0
        self.refused_with: set[int] = set()
        self.states: set[str] = set()
        self.between: Callable[[Framed, Callable[[], VirtualReply | None]], VirtualReply | None] = lambda _, act: act()
        self._plugin = plugin

    def time_of(self, now: float) -> float:
        """Return the drive's own time: the line's time plus the seconds since mains were switched on."""
        return now + BEFORE_S

    def hear(self, find: Framed | Damaged, now: float) -> VirtualReply | None:
        """Pass a telegram to the drive, and record the request and its effect."""
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
            ran, runs = before is MotorCommand.RUN, after is MotorCommand.RUN
            self.heard.append(
                ObservedRequest(
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
        """Return a refusal of a request with this code; None if drives of the protocol do not refuse such a request."""
        inner = self.inner
        reply = inner.refusing(find, code, self.time_of(now)) if isinstance(inner, Refuses) else None
        if reply is not None:
            self.refused_with.add(code)
        return reply

    def since(self, number: int = 0) -> list[ObservedRequest]:
        """Return the requests from this index on."""
        with self.alone:
            return list(self.heard)[number:]

    def answered(self, reply: bytes) -> ObservedRequest | None:
        """Return the latest request whose reply was these bytes, or None."""
        return next((each for each in reversed(self.since()) if each.reply == reply), None)

    def power_cycle(self, now: float) -> None:
        """Switch mains off and on."""
        with self.alone:
            # The line has stopped the motor in the line's time; the motor runs on the drive's time.
            self.motor.stop(MotorCommand.OFF, self.time_of(now))
            super().power_cycle(now)
