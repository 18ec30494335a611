"""The seam between the link and whatever carries bytes."""

from __future__ import annotations

from collections.abc import Generator
from typing import TYPE_CHECKING, NamedTuple, Protocol, TypeAlias, TypeVar

if TYPE_CHECKING:
    from drivecomm.protocol import LineSettings

T = TypeVar("T")


class Port(Protocol):
    """An open port. Everything but `close` may raise LinkDownError."""

    @property
    def paced(self) -> bool:
        """Whether characters take their time on it, as on a real line; False for a network or a pseudo-terminal."""

    @property
    def real_time(self) -> bool:
        """Whether its clock is that of the world; on a virtual line waiting takes no time at all."""

    @property
    def descriptor(self) -> int | None:
        """What becomes readable when bytes have come, for an event loop; None where there is no such thing."""

    def now(self) -> float:
        """Return the time on the clock that `until` arguments refer to, in seconds."""

    def wall_time(self) -> float:
        """Return the time for people: seconds since 1970, on a virtual line since its start."""

    def configure(self, settings: LineSettings) -> str:
        """Set the line settings; return a note when this port cannot carry all of them, otherwise nothing."""

    def write(self, data: bytes) -> None:
        """Hand over bytes for sending; returns before they are on the line."""

    def read(self, until: float, at_least: int) -> bytes:
        """Return all bytes that are there as soon as there are this many, at `until` with what there is."""

    def take(self) -> bytes:
        """Return what is there now."""

    def hold_back(self, at_least: int) -> None:
        """Let `descriptor` become readable for no fewer bytes than this, where the system can."""

    def wait(self, until: float) -> None:
        """Let time pass."""

    def close(self) -> None:
        """Give the port back."""


class PortProxy:
    """Stands in for a port and passes on to it whatever a subclass does not change."""

    def __init__(self, port: Port) -> None:
        self._port = port
        self.paced = port.paced
        self.real_time = port.real_time
        self.descriptor = port.descriptor

    def now(self) -> float:
        """Return the port's time."""
        return self._port.now()

    def wall_time(self) -> float:
        """Return the port's time for people."""
        return self._port.wall_time()

    def configure(self, settings: LineSettings) -> str:
        """Set the line settings."""
        return self._port.configure(settings)

    def write(self, data: bytes) -> None:
        """Send."""
        self._port.write(data)

    def read(self, until: float, at_least: int) -> bytes:
        """Return what comes."""
        return self._port.read(until, at_least)

    def take(self) -> bytes:
        """Return what is there."""
        return self._port.take()

    def hold_back(self, at_least: int) -> None:
        """Become readable for no fewer bytes than this."""
        self._port.hold_back(at_least)

    def wait(self, until: float) -> None:
        """Let time pass."""
        self._port.wait(until)

    def close(self) -> None:
        """Give the port back."""
        self._port.close()


class Configure(NamedTuple):
    """Set the port to these line settings."""

    settings: LineSettings


class Send(NamedTuple):
    """Write these bytes."""

    data: bytes


class Receive(NamedTuple):
    """Wait for bytes until this time; return early only with at least this many.

    gives_way: return early, too, when a stop waits for the line.
    """

    until: float
    at_least: int = 1
    gives_way: bool = False


class Wait(NamedTuple):
    """Let time pass until then. gives_way: return early when a stop waits for the line."""

    until: float
    gives_way: bool = False


class Talk:
    """Send a request when the line is free, and wait for its reply: what most exchanges need, as one effect.

    Wait until `free_at`, whoever else waits. See whether something has come that nobody asked for: then end with it,
    and send nothing. Otherwise set `begun` to the time, write `data`, and receive as `Receive` does, at most until the
    bytes have been on the wire for `wire_s` and `reply_s` more are over, and not beyond `deadline` once they are on the
    wire. With an `at_least` of 0 nothing is received.

    begun: what came of it as far as it was carried out, also where it was interrupted: when the bytes were handed
    over, None while they were not.
    """

    __slots__ = ("at_least", "begun", "data", "deadline", "free_at", "gives_way", "reply_s", "wire_s")

    def __init__(self) -> None:
        self.free_at = 0.0
        self.data = b""
        self.wire_s = 0.0
        self.reply_s = 0.0
        self.deadline = float("inf")
        self.at_least = 0
        self.gives_way = False
        self.begun: float | None = None

    @property
    def until(self) -> float:
        """How long its reply is waited for, once it has begun."""
        sent_at = (self.begun or 0.0) + self.wire_s
        until = sent_at + self.reply_s
        return until if until <= self.deadline else max(self.deadline, sent_at)


SingleEffect: TypeAlias = Configure | Send | Receive | Wait
Effect: TypeAlias = SingleEffect | Talk


class Arrival(NamedTuple):
    """The time, the bytes that came (for Receive and Talk), and what the port says of its settings (for Configure)."""

    time: float
    data: bytes = b""
    note: str = ""


Steps: TypeAlias = Generator[Effect, Arrival, T]


def taken_apart(steps: Steps[T], now: float) -> Generator[SingleEffect, Arrival, T]:
    """Carry out steps that begin at this time with each `Talk` as the single effects that it stands for."""
    try:
        effect = next(steps)
        while True:
            arrival = (yield from _in_single_effects(effect, now)) if isinstance(effect, Talk) else (yield effect)
            now = arrival.time
            effect = steps.send(arrival)
    except StopIteration as finished:
        result: T = finished.value
        return result
    finally:
        steps.close()


def _in_single_effects(talk: Talk, now: float) -> Generator[SingleEffect, Arrival, Arrival]:
    if now < talk.free_at:
        now = (yield Wait(talk.free_at)).time
    unasked = yield Receive(now)
    if unasked.data:
        return unasked
    talk.begun = unasked.time
    written = yield Send(talk.data)
    if not talk.at_least:
        return written
    return (yield Receive(talk.until, talk.at_least, talk.gives_way))
