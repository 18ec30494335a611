"""The drives of one line as its master knows them: their identity, their communication, and their commands."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

from drivecomm import models
from drivecomm.bus.exchanges import setting_up
from drivecomm.bus.read_only import ReadOnly
from drivecomm.bus.series_proof import ProvenDrives, SeriesProof
from drivecomm.bus.stored_writes import ALLOWED, StoredWrites
from drivecomm.errors import NotSupported, UsageError, shortened
from drivecomm.link import CommandHistory, Link, Peer
from drivecomm.protocol import (
    CONFIRMED,
    CONFIRMED_FACTS,
    checked_address,
    installed,
    is_duration,
    line_overrides,
    resolve_options,
)

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from drivecomm.link import Echo, TraceEvent
    from drivecomm.protocol import DriveConfig, Exchange, Model, Operations, Protocol


class DriveParts(NamedTuple):
    """The parts of a drive object."""

    peer: Peer
    operations: Operations
    model: Model | None


class _SetUp(NamedTuple):
    operations: Operations
    writes: Mapping[str, Any]
    prove: Callable[[], Exchange[None]] | None


class LineDrives:
    """The drives of one line, and its link.

    facts: line facts for all drives; None for each fact that is not given. port: name of the port, if it has one. The
    other arguments are those of `open_bus`.
    """

    def __init__(
        self,
        facts: Mapping[str, Any] | None = None,
        trace: Callable[[TraceEvent], None] | None = None,
        echo: bool | Echo = "off",
        guard_s: float = 0.005,
        stored_writes_per_hour: int = ALLOWED,
        *,
        port: str = "",
    ) -> None:
        self._overrides = line_overrides(facts or {})
        self.echo = _echo_mode(echo)
        self.port = port
        if not is_duration(guard_s):
            raise UsageError(f"invalid guard_s = {shortened(guard_s)}; give seconds, 0 or more")
        if trace is not None and not callable(trace):
            raise UsageError(f"invalid trace = {shortened(trace)}; give a function that is called with each event")
        self.stored_writes = StoredWrites(stored_writes_per_hour)
        self.commands = CommandHistory()
        self.proven = ProvenDrives(_warn)
        self.link = Link(trace=trace, echo=self.echo, guard_s=guard_s, away=self._away, on_shared=self._warn_shared)
        self._drives: dict[str, Mapping[str, Any]] = {}
        self._set_up: dict[str, _SetUp] = {}

    def member(
        self,
        protocol: str,
        address: int,
        model: str | Path | Model | None,
        set_up: Mapping[str, Any] | None,
        options: Mapping[str, Any],
        *,
        read_only: bool = False,
    ) -> DriveParts:
        """Return the parts of the drive at an address. Raises UsageError for invalid arguments."""
        plugin = installed[protocol]
        if set_up is not None and not isinstance(set_up, Mapping):
            raise UsageError(f"invalid set_up = {shortened(set_up)}; give parameters and their values")
        if not isinstance(read_only, bool):
            raise UsageError(f"invalid read_only = {shortened(read_only)}; give True or False")
        known = None if model is None else models.load_model(plugin.package, protocol, model)
        if checked := options.get(CONFIRMED_FACTS):
            known = models.with_confirmed(known, checked)
        facts, chosen = resolve_options(plugin, known, self._at_port(plugin, options), for_all=self._overrides)
        checked_address(plugin, address, chosen)
        name = f"{plugin.name}:{address}"
        remembered = () if plugin.memory is None else (self.commands.memory(name, plugin.memory),)
        operations: Operations = plugin.operations(address, chosen, known, *remembered)
        proof = None
        if known is not None and not read_only:
            proof = SeriesProof(
                name=name,
                plugin=plugin,
                model=known,
                operations=operations,
                confirmed=str(options.get(CONFIRMED, "")),
                proven=self.proven,
            )
        if read_only:
            if set_up:
                raise UsageError(
                    f"{name} cannot be set up, because it is read-only; leave read_only=True out", says="read_only=True"
                )
            reason = f"{name} is read-only; leave read_only=True out to write or command it"
            operations = ReadOnly(partial(plugin.operations, address, chosen, known), reason, plugin.intent)
        if set_up:
            self._set_up[name] = _SetUp(operations, dict(set_up), None if proof is None else proof.prove)
            for parameter in set_up:
                self.stored_writes.kept_in_ram(name, operations.address_of(parameter))

        peer = Peer(
            name=name,
            codec=plugin.codec(chosen),
            facts=facts,
            mismatch=plugin.mismatch,
            line_errors=plugin.line_errors,
            probe=operations.probe,
            set_up=partial(self._setting_up_again, name),
            prove=None if proof is None else proof.prove,
            check_series=None if proof is None else proof.check,
        )
        if set_up:
            self.link.must_set_up(peer)
        return DriveParts(peer, operations, known)

    def _setting_up_again(self, name: str) -> Exchange[None]:
        """Set up a drive as it was last requested, whichever object for the drive is used first."""
        wanted = self._set_up.get(name)
        if wanted is None:
            return
        if wanted.prove is not None:
            yield from wanted.prove()
        yield from setting_up(wanted.operations, wanted.writes)

    def is_foreign(self, plugin: Protocol) -> bool:
        """Return whether the port carries only one protocol, and this is another one."""
        if "://" not in self.port:
            return False
        # Imported here, because only opening a port needs the transport.
        from drivecomm.transport import ONE_PROTOCOL, scheme_of

        scheme = scheme_of(self.port)
        return scheme in ONE_PROTOCOL and scheme not in plugin.schemes

    def _at_port(self, plugin: Protocol, options: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the options of a drive at this port: those of the port's scheme, then the given ones."""
        if self.is_foreign(plugin):
            raise UsageError(
                f"{plugin.name} is not supported at {self.port}; use socket://HOST:PORT for its serial line"
            )
        brings = plugin.schemes.get(self.port.split("://", 1)[0].lower(), {})
        for name in brings.keys() & options.keys():
            if options[name] != brings[name]:
                raise UsageError(
                    f"{name}={shortened(options[name])} cannot be at {self.port}, where it is {brings[name]}; "
                    "leave it out, or use socket://HOST:PORT",
                    says=name,
                )
        return {**brings, **options}

    def all_drives(self, protocol: str, model: str | Path | Model | None, options: Mapping[str, Any]) -> DriveParts:
        """Return the parts of an object for all drives of a protocol. Raises NotSupported if it has no broadcast."""
        plugin = installed[protocol]
        if plugin.broadcast_address is None:
            raise NotSupported(f"{protocol} has no broadcast; command its drives one by one")
        known = None if model is None else models.load_model(plugin.package, protocol, model)
        facts, chosen = resolve_options(plugin, known, self._at_port(plugin, options), for_all=self._overrides)
        peer = Peer(name=f"{plugin.name}:*", codec=plugin.codec(chosen), facts=facts, mismatch=plugin.mismatch)
        return DriveParts(peer, plugin.operations(plugin.broadcast_address, chosen, known), known)

    def add(self, name: str, model: str | Path | Model | None, options: Mapping[str, Any]) -> None:
        """Record that there is an object for a drive; options with a model replace those without one.

        Without its model, a drive may be impossible to stop (Modbus).
        """
        known = self._drives.get(name)
        if known is None or model is not None or "model" not in known:
            self._drives[name] = dict(options) if model is None else {"model": model, **options}

    @property
    def drives(self) -> tuple[DriveConfig, ...]:
        """The drives for which objects were made, in the order of their first objects."""
        return tuple(_config(name, options) for name, options in self._drives.items())

    def names(self) -> set[str]:
        """Return the names of the drives for which objects were made, as PROTOCOL:ADDRESS."""
        return set(self._drives)

    def _away(self, name: str) -> None:
        self.commands.forget(name)
        self.proven.forget(name)

    def _warn_shared(self, why: str) -> None:
        _warn(f"{', '.join(sorted(self._drives))}: {why}")


def _config(name: str, options: Mapping[str, Any]) -> DriveConfig:
    # Imported here, because only stopping a whole line needs the description of a plant's drives.
    from drivecomm.protocol import DriveConfig

    protocol, _, address = name.partition(":")
    return DriveConfig(protocol=protocol, address=int(address), options=options)


def _warn(text: str) -> None:
    # Imported here, because most lines have no warnings, and then need no logging.
    from logging import getLogger

    getLogger("drivecomm.bus").warning("%s", text)


def _echo_mode(echo: bool | Echo) -> Echo:
    """Return the echo mode: True means "expect", False means "off"."""
    if echo in ("off", "expect", "auto"):
        return echo
    if isinstance(echo, bool):
        return "expect" if echo else "off"
    raise UsageError(f"invalid echo = {shortened(echo)}; use off, expect or auto")
