"""Interface between the link and the ports that carry its bytes."""

from __future__ import annotations

from collections.abc import Generator
from typing import TYPE_CHECKING, NamedTuple, Protocol, TypeAlias, TypeVar

if TYPE_CHECKING:
    from drivecomm.protocol import LineSettings

T = TypeVar("T")


class Port(Protocol):
    """An open port. Every method except `close` may raise LinkDownError."""

    @property
    def paced(self) -> bool:
        """Whether characters take their real time, as on a serial line; False for a network or a pseudo-terminal."""

    @property
    def real_time(self) -> bool:
        """Whether its clock runs in real time; on a virtual line waiting takes no time."""

    @property
    def descriptor(self) -> int | None:
        """Descriptor that becomes readable when bytes arrive, for an event loop; None if the port has none."""

    def now(self) -> float:
        """Return the time on the clock that `until` arguments refer to, in seconds."""

    def wall_time(self) -> float:
        """Return the time for people: seconds since 1970; on a virtual line, seconds since its start."""

    def configure(self, settings: LineSettings) -> str:
        """Set the line settings; return a note if this port cannot use all of them, otherwise an empty string."""

    def write(self, data: bytes) -> None:
        """Hand over bytes for sending, and return before they are on the line."""

    def read(self, until: float, at_least: int) -> bytes:
        """Return all received bytes as soon as there are `at_least` of them; at `until`, return what has come."""

    def take(self) -> bytes:
        """Return the bytes received so far, without waiting."""

    def hold_back(self, at_least: int) -> None:
        """Make `descriptor` readable only for at least this many bytes, if the system supports it."""

    def wait(self, until: float) -> None:
        """Wait until this time."""

    def close(self) -> None:
        """Close the port."""


class PortProxy:
    """Proxy that passes every call on to a port, unless a subclass overrides it."""

    def __init__(self, port: Port) -> None:
        self._port = port
        self.paced = port.paced
        self.real_time = port.real_time
        self.descriptor = port.descriptor

    def now(self) -> float:
        """Return the time on the port's clock."""
        return self._port.now()

    def wall_time(self) -> float:
        """Return the port's time for people."""
        return self._port.wall_time()

    def configure(self, settings: LineSettings) -> str:
        """Set the line settings of the port."""
        return self._port.configure(settings)

    def write(self, data: bytes) -> None:
        """Hand over bytes for sending."""
        self._port.write(data)

    def read(self, until: float, at_least: int) -> bytes:
        """Return the received bytes, as `Port.read` does."""
        return self._port.read(until, at_least)

    def take(self) -> bytes:
        """Return the bytes received so far, without waiting."""
        return self._port.take()

    def hold_back(self, at_least: int) -> None:
        """Make the descriptor readable only for at least this many bytes."""
        self._port.hold_back(at_least)

    def wait(self, until: float) -> None:
        """Wait until this time."""
        self._port.wait(until)

    def close(self) -> None:
        """Close the port."""
        self._port.close()


class Configure(NamedTuple):
    """Effect that sets the line settings of the port."""

    settings: LineSettings


class Send(NamedTuple):
    """Effect that writes bytes."""

    data: bytes


class Receive(NamedTuple):
    """Effect that waits for bytes until a time, or until `at_least` of them are there.

    gives_way: whether to return early, too, if a stop waits for the line.
    """

    until: float
    at_least: int = 1
    gives_way: bool = False


class Wait(NamedTuple):
    """Effect that lets time pass. gives_way: whether to return early if a stop waits for the line."""

    until: float
    gives_way: bool = False


class Transaction:
    """Effect that sends a request when the line is free and waits for its reply; most exchanges need nothing else.

    The runner waits until `free_at`, even if a stop waits. If bytes have come unasked by then, it returns them and
    sends nothing. Otherwise it sets `begun` to the time, writes `data`, and receives as for `Receive`: until the bytes
    have been on the wire for `wire_s` and another `reply_s` has passed, but not beyond `deadline` once they are on the
    wire. With an `at_least` of 0 nothing is received.

    begun: time when the bytes were handed over, also valid after an interruption; None if they were not handed over.
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
        """End of the wait for the reply, after sending."""
        sent_at = (self.begun or 0.0) + self.wire_s
        until = sent_at + self.reply_s
        return until if until <= self.deadline else max(self.deadline, sent_at)


SingleEffect: TypeAlias = Configure | Send | Receive | Wait
Effect: TypeAlias = SingleEffect | Transaction


class Arrival(NamedTuple):
    """Result of an effect: the time, the received bytes (Receive and Transaction), and the port's note (Configure)."""

    time: float
    data: bytes = b""
    note: str = ""


LinkSteps: TypeAlias = Generator[Effect, Arrival, T]


def split_transactions(steps: LinkSteps[T], now: float) -> Generator[SingleEffect, Arrival, T]:
    """Run steps that begin at this time, with each `Transaction` split into the single effects that it stands for."""
    try:
        effect = next(steps)
        while True:
            arrival = (
                (yield from _in_single_effects(effect, now)) if isinstance(effect, Transaction) else (yield effect)
            )
            now = arrival.time
            effect = steps.send(arrival)
    except StopIteration as finished:
        result: T = finished.value
        return result
    finally:
        steps.close()


def _in_single_effects(talk: Transaction, now: float) -> Generator[SingleEffect, Arrival, Arrival]:
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
