"""What the verbs of one drive and those of all drives of a protocol rest on."""

from __future__ import annotations

from copy import copy
from typing import TYPE_CHECKING, Any, Generic, Protocol, Self, TypeVar

from drivecomm.bus.discoverable import Discoverable
from drivecomm.bus.exchanges import Exchanges
from drivecomm.bus.faces import Sent
from drivecomm.errors import UsageError
from drivecomm.line import Job, Rank

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from drivecomm.link import CommandCall, Peer
    from drivecomm.protocol import Capabilities, Exchange, MachineUnit, Model, Operations

T = TypeVar("T")


class VerbsBus(Protocol):
    """What the verbs need of a bus."""

    def command(self, peer: Peer, check: Callable[[], None] | None = None) -> CommandCall | None:
        """Take note that a drive, or all drives of a protocol, are to be commanded; a later stop cancels that.

        check: raises when that must not be sent any more; asked right before it is.
        """

    def watched(self, peer: Peer, silence_s: float | None) -> None:
        """Take note how long a drive's watchdog waits; None when it is off, or not known."""

    def wall_time(self) -> float:
        """Return the time in seconds since 1970; on a virtual line since its start."""

    def storing(self, peer: Peer, parameter: str) -> None:
        """Count a write that may end in EEPROM. Raises UsageError for one too many within an hour."""

    def kept_in_ram(self, peer: Peer, parameter: str) -> None:
        """Take note of a write that the drive forgets without power."""

    def in_ram_only(self, peer: Peer) -> frozenset[str]:
        """Return the parameters of a drive that were written and not stored since, as far as is known here."""


B = TypeVar("B", bound=VerbsBus)


class PeerVerbs(Discoverable, Generic[B]):
    """What the verbs of one drive and those of all drives of a protocol need."""

    _inner = frozenset({"bus", "checked", "peer", "with_stop_notice"})
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
        """The bus that it is on."""
        return self._bus

    @property
    def peer(self) -> Peer:
        """What the link sees of it."""
        return self._peer

    @property
    def capabilities(self) -> Capabilities:
        """What it can be asked to do."""
        return self._exchanges.capabilities

    def checked(self, check: Callable[[], None]) -> Self:
        """Return the same again, whose commands are looked at once more when their turn on the line has come.

        check: called right before each command is sent; what it raises is raised in place of sending. Raises UsageError
        for a drive of a server, to which no function can be sent.
        """
        if isinstance(self, Sent):
            raise UsageError(f"{self!r} is on a line of a server, to which no check of a program's own can be sent")
        other = copy(self)
        other._check = check  # noqa: SLF001 - one of its own kind
        return other

    def with_stop_notice(self, goes_out: Callable[[], None]) -> Self:
        """Return a copy whose stops call `goes_out` right before their first telegram, when the line is theirs.

        Not for a drive of a server, which calls nothing.
        """
        other = copy(self)
        other._stop_goes_out = goes_out  # noqa: SLF001 - one of its own kind
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
    # An exchange begins when its turn on the line has come.
    goes_out()
    yield from exchange


def _proven_first(proof: Exchange[None], exchange: Exchange[T]) -> Exchange[T]:
    yield from proof
    return (yield from exchange)
