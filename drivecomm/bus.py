"""One line and its drives, from the master's side."""

from __future__ import annotations

from dataclasses import dataclass, fields
from threading import RLock
from typing import TYPE_CHECKING, Any, Self, TypeVar
from weakref import WeakSet

from drivecomm.drive import Broadcast, Drive
from drivecomm.errors import AddressError, LinkDownError, NoReplyError, NotSupported, ReplyError, UsageError
from drivecomm.line import LINE_FACT_NAMES
from drivecomm.link import Link, Party
from drivecomm.models import load_model
from drivecomm.registry import installed
from drivecomm.runners.blocking import run

if TYPE_CHECKING:
    from collections import Counter
    from collections.abc import Callable, Iterable, Iterator, Mapping
    from pathlib import Path
    from types import TracebackType

    from drivecomm.exchange import Exchange
    from drivecomm.line import LineFacts, Parity
    from drivecomm.link import TraceEvent
    from drivecomm.models import Model
    from drivecomm.protocol import Protocol
    from drivecomm.runners.blocking import Port

T = TypeVar("T")


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """A drive that a scan met: where, and what it tells of itself. sound: False if it answered with damage only."""

    protocol: str
    address: int
    identity: Mapping[str, str]
    sound: bool
    detail: str = ""

    @property
    def name(self) -> str:
        """The drive as the command line names it."""
        return f"{self.protocol}:{self.address}"


class Bus:
    """The master's side of one line. Runs one exchange at a time, whoever asks; may be used from many threads.

    open_port: opens the port, at once and again after it was lost. overrides: line facts that hold for all drives.
    """

    def __init__(
        self,
        open_port: Callable[[], Port],
        *,
        overrides: Mapping[str, Any] | None = None,
        trace: Callable[[TraceEvent], None] | None = None,
        echo: bool = False,
        guard_s: float = 0.005,
    ) -> None:
        self._open_port = open_port
        self._overrides = dict(overrides or {})
        self._link = Link(trace=trace, echo=echo, guard_s=guard_s)
        self._lock = RLock()
        self._closed = False
        self._drives: WeakSet[Drive] = WeakSet()
        self._port: Port | None = open_port()
        self._link.paced = self._port.paced
        self._wall_time = self._port.wall_time()

    def drive(self, protocol: str, address: int, *, model: str | Path | Model | None = None, **options: Any) -> Drive:
        """Return the drive at an address; nothing is sent.

        model: a model of the protocol's package by name, or a TOML file. options: line facts of this drive (baudrate,
        parity, reply_timeout_s, attempts, ...) and the protocol's own drive options. Raises UsageError for anything
        that cannot be.
        """
        plugin = installed[protocol]
        if type(address) is not int or address not in plugin.addresses:
            allowed = f"{plugin.addresses.start} to {plugin.addresses.stop - 1}"
            raise AddressError(f"{protocol} has no drive at address {address}; addresses are {allowed}")
        known = None if model is None else load_model(plugin.package, protocol, model)
        party, chosen = self._party(plugin, address, known, options)
        drive = Drive(self, party, plugin.operations(address, chosen, known), known)
        self._drives.add(drive)
        return drive

    def broadcast(self, protocol: str, *, model: str | Path | Model | None = None, **options: Any) -> Broadcast:
        """Return all drives of a protocol at once; what is sent to them is never answered."""
        plugin = installed[protocol]
        if plugin.broadcast_address is None:
            raise NotSupported(f"{protocol} has no broadcast; command its drives one by one")
        known = None if model is None else load_model(plugin.package, protocol, model)
        party, chosen = self._party(plugin, plugin.broadcast_address, known, options)
        return Broadcast(self, party, plugin.operations(plugin.broadcast_address, chosen, known))

    def scan(
        self,
        only: Iterable[str] | None = None,
        addresses: Iterable[int] | None = None,
        *,
        progress: Callable[[str, int, int], None] | None = None,
        **options: Any,
    ) -> Iterator[Found]:
        """Yield the drives that answer, protocol by protocol; sends only what cannot move a motor.

        only: protocol names, all installed ones if absent. addresses: those to ask, the protocol's usual ones if
        absent; addresses that a protocol does not have are left out. progress: told the protocol, how many addresses
        are done, and how many there are. options: line facts for all drives asked.
        """
        plugins = [installed[name] for name in only] if only is not None else list(installed.working())
        wanted = None if addresses is None else list(addresses)
        plan = [
            (plugin, address)
            for plugin in plugins
            for address in (wanted if wanted is not None else plugin.scan_addresses)
            if address in plugin.addresses
        ]
        for done, (plugin, address) in enumerate(plan):
            if progress is not None:
                progress(plugin.name, done, len(plan))
            found = self._probe(self.drive(plugin.name, address, **options), plugin.name, address)
            if found is not None:
                yield found
        if progress is not None and plan:
            progress(plan[-1][0].name, len(plan), len(plan))

    def _probe(self, drive: Drive, protocol: str, address: int) -> Found | None:
        try:
            drive.probe()
        except NoReplyError:
            return None
        except ReplyError as error:
            return Found(protocol=protocol, address=address, identity={}, sound=False, detail=str(error))
        try:
            identity = drive.identify()
        except ReplyError as error:
            return Found(protocol=protocol, address=address, identity={}, sound=True, detail=str(error))
        return Found(protocol=protocol, address=address, identity=identity, sound=True)

    def run(self, party: Party, exchange: Exchange[T]) -> T:
        """Carry out an exchange with a drive; waits for its turn. A port that was lost is opened again first."""
        with self._lock:
            port = self._opened()
            try:
                return run(self._link.run(party, exchange), port)
            except LinkDownError:
                self._port = None
                port.close()
                raise
            finally:
                self._wall_time = port.wall_time()

    def commanding(self, who: Drive | Broadcast) -> None:
        """Let all other objects for the same drive, or drives, forget what they commanded last."""
        protocol, _, address = who.party.name.partition(":")
        for drive in list(self._drives):
            name, _, number = drive.party.name.partition(":")
            if drive is not who and name == protocol and address in (number, "*"):
                drive.commanded_elsewhere()

    def wall_time(self) -> float:
        """Return when the last exchange ended, in seconds since 1970 (on a virtual line: since its start)."""
        return self._wall_time

    @property
    def counters(self) -> Mapping[str, Counter[str]]:
        """What happened so far, by drive: requests, replies, retries, timeouts, and each kind of error."""
        return self._link.counters

    def close(self) -> None:
        """Give the port back; the bus cannot be used any more."""
        with self._lock:
            self._closed = True
            if self._port is not None:
                self._port.close()
                self._port = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def _opened(self) -> Port:
        if self._closed:
            raise UsageError("this bus is closed; open it again with open_bus")
        if self._port is None:
            self._port = self._open_port()
            self._link.paced = self._port.paced
            self._link.reopened()
        return self._port

    def _party(
        self, plugin: Protocol, address: int, model: Model | None, options: Mapping[str, Any]
    ) -> tuple[Party, Any]:
        own = {field.name for field in fields(plugin.options)}
        unknown = sorted(set(options) - own - LINE_FACT_NAMES)
        if unknown:
            known = ", ".join(sorted(own | LINE_FACT_NAMES))
            raise UsageError(f"{plugin.name} drives have no option {unknown[0]!r}; they have {known}")
        layers = [self._from_model(plugin, model, own), self._overrides, options]
        facts: LineFacts = plugin.facts
        for layer in layers:
            facts = facts.override({name: value for name, value in layer.items() if name in LINE_FACT_NAMES})
        chosen = plugin.options(**{name: value for layer in layers for name, value in layer.items() if name in own})
        name = "*" if address == plugin.broadcast_address else str(address)
        return Party(
            name=f"{plugin.name}:{name}", codec=plugin.codec(chosen), facts=facts, mismatch=plugin.mismatch
        ), chosen

    def _from_model(self, plugin: Protocol, model: Model | None, own: set[str]) -> Mapping[str, Any]:
        given = model.options if model else {}
        unknown = sorted(set(given) - own - LINE_FACT_NAMES)
        if unknown:
            raise UsageError(
                f"model {model.name if model else ''} sets {unknown[0]!r}, which {plugin.name} does not have"
            )
        return given


def open_bus(
    port: str | Callable[[], Port],
    *,
    baudrate: int | None = None,
    bytesize: int | None = None,
    parity: Parity | None = None,
    stopbits: float | None = None,
    reply_timeout_s: float | None = None,
    attempts: int | None = None,
    echo: bool = False,
    guard_s: float = 0.005,
    trace: Callable[[TraceEvent], None] | None = None,
    **facts: float | None,
) -> Bus:
    """Open a line and return its bus, a context manager.

    port: what pyserial opens ("/dev/ttyUSB0", "COM3", "socket://host:4001", "rfc2217://host:4001", "loop://"), or a
    function that returns a port, such as `VirtualLine.port`. baudrate, bytesize, parity, stopbits, reply_timeout_s,
    attempts: for all drives, instead of their protocols' defaults. echo: the adapter hands back what it sends.
    guard_s: quiet time after a change of line settings. trace: called for everything that happens on the line. facts:
    further timing for all drives, by the names of `Timing`, such as gap_s or turnaround_s.

    Raises PortError when the port does not exist or is in use, UsageError for a name that is no line fact.
    """
    unknown = sorted(set(facts) - LINE_FACT_NAMES)
    if unknown:
        raise UsageError(f"a line has no fact {unknown[0]!r}; it has {', '.join(sorted(LINE_FACT_NAMES))}")
    overrides = {
        "baudrate": baudrate,
        "bytesize": bytesize,
        "parity": parity,
        "stopbits": stopbits,
        "reply_timeout_s": reply_timeout_s,
        "attempts": attempts,
        **facts,
    }
    return Bus(
        _opener(port) if isinstance(port, str) else port,
        overrides={name: value for name, value in overrides.items() if value is not None},
        trace=trace,
        echo=echo,
        guard_s=guard_s,
    )


def _opener(url: str) -> Callable[[], Port]:
    def open_port() -> Port:
        # pyserial is loaded by those who open a port, not by those who import drivecomm.
        from drivecomm.transport.serial_port import SerialPort  # noqa: PLC0415

        return SerialPort(url)

    return open_port
