"""Common base of the verbs of one drive and of those of all drives of a protocol."""

from __future__ import annotations

from copy import copy
from typing import TYPE_CHECKING, Any, Generic, Protocol, Self, TypeVar

from drivecomm.bus.call_styles import RemoteCalls
from drivecomm.bus.discoverable import Discoverable
from drivecomm.bus.exchanges import Exchanges
from drivecomm.errors import UsageError
from drivecomm.line import Job, Rank

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from drivecomm.link import CommandCall, Peer
    from drivecomm.protocol import Capabilities, Exchange, MachineUnit, Model, Operations

T = TypeVar("T")


class VerbsBus(Protocol):
    """Interface of a bus that the verbs need."""

    def command(self, peer: Peer, check: Callable[[], None] | None = None) -> CommandCall | None:
        """Register a command for a drive, or for all drives of a protocol; a later stop cancels it.

        check: called right before sending; raises if the command must not be sent any more.
        """

    def watched(self, peer: Peer, silence_s: float | None) -> None:
        """Record how many seconds a drive's watchdog waits; None if the watchdog is off, or unknown."""

    def wall_time(self) -> float:
        """Return the time in seconds since 1970; on a virtual line since its start."""

    def storing(self, peer: Peer, parameter: str) -> None:
        """Count a write that may go to EEPROM. Raises UsageError if there are too many within an hour."""

    def kept_in_ram(self, peer: Peer, parameter: str) -> None:
        """Record a write that the drive loses without power."""

    def in_ram_only(self, peer: Peer) -> frozenset[str]:
        """Return the parameters of a drive that were written and not stored since, as far as this bus knows."""


B = TypeVar("B", bound=VerbsBus)


class PeerVerbs(Discoverable, Generic[B]):
    """Base of the verbs of one drive, and of those of all drives of a protocol."""

    _inner = frozenset({"bus", "peer", "with_check", "with_stop_notice"})
    _check: Callable[[], None] | None = None
    _stop_goes_out: Callable[[], None] | None = None

    def __init__(
        self,
        bus: B,
        peer: Peer,
        operations: Operations,
        model: Model | None = None,
        machine: MachineUnit | None = None,
    ) -> None:
        self._bus = bus
        self._peer = peer
        self._exchanges = Exchanges(peer.name, operations, model, machine)

    @property
    def bus(self) -> B:
        """The bus of the drive."""
        return self._bus

    @property
    def peer(self) -> Peer:
        """The drive as the link sees it."""
        return self._peer

    @property
    def capabilities(self) -> Capabilities:
        """Capabilities of the drive."""
        return self._exchanges.capabilities

    def with_check(self, check: Callable[[], None]) -> Self:
        """Return a copy whose commands are checked again when their turn on the line has come.

        check: called right before each command is sent; if it raises, the command is not sent, and the caller gets the
        error. Raises UsageError for a drive of a server, to which no function can be sent.
        """
        if isinstance(self, RemoteCalls):
            raise UsageError(f"{self!r} is on a line of a server, to which no check of a program's own can be sent")
        other = copy(self)
        other._check = check  # noqa: SLF001 - an object of the same class
        return other

    def with_stop_notice(self, goes_out: Callable[[], None]) -> Self:
        """Return a copy whose stops call `goes_out` right before their first telegram, when they have the line.

        Not for a drive of a server: a server does not call the function.
        """
        other = copy(self)
        other._stop_goes_out = goes_out  # noqa: SLF001 - an object of the same class
        return other

    def _stop(self, exchange: Exchange[None], again: Callable[[], Exchange[None]] | None = None) -> Job[None]:
        if self._stop_goes_out is not None:
            exchange = _noticed(self._stop_goes_out, exchange)
        return Job(self._peer, exchange, Rank.STOP, again=again)

    def _command(self, exchange: Exchange[T]) -> Job[T]:
        if self._peer.prove is not None:
            exchange = _proven_first(self._peer.prove(), exchange)
        return Job(self._peer, exchange, Rank.COMMAND, self._bus.command(self._peer, self._check))

    def _write(self, parameter: str, options: Mapping[str, Any], exchange: Exchange[T]) -> Job[T]:
        address, is_stored = self._exchanges.written_parameter(parameter, options)
        if is_stored:
            self._bus.storing(self._peer, address)
        elif self._exchanges.capabilities.volatile_writes:
            self._bus.kept_in_ram(self._peer, address)
        return self._command(exchange)


def _noticed(goes_out: Callable[[], None], exchange: Exchange[None]) -> Exchange[None]:
    # An exchange begins only when its turn on the line has come.
    goes_out()
    yield from exchange


def _proven_first(proof: Exchange[None], exchange: Exchange[T]) -> Exchange[T]:
    yield from proof
    return (yield from exchange)
