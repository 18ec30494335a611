"""Drive whose line a server owns: its verbs are sent to the server by their names and arguments.

The verbs are those that `DriveVerbs` declares, so a new verb needs no change here. The local objects of a drive are
made on first use: most programs do without them, and then load neither the protocol's package nor its models.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.bus import Exchanges, ReadOnly, RemoteCalls
from drivecomm.client.line_of_server import READING
from drivecomm.errors import DriveCommError, ReadOnlyError, UsageError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from decimal import Decimal

    from drivecomm.bus import DriveParts, Feeding
    from drivecomm.client.connection import LocalServer
    from drivecomm.client.line_of_server import LineOfServer
    from drivecomm.line import Job
    from drivecomm.link import Peer
    from drivecomm.protocol import DriveConfig, LinkLoss, MachineUnit, Stop

_MADE_LATER = frozenset({"_peer", "_exchanges", "model"})


class RemoteDriveBase(RemoteCalls):
    """Base of `Drive` and `AsyncDrive` objects on a line that a server owns; made by the bus.

    config: the drive with all its options. said: the options that the server does not know. known: the drive in the
    server's plant, None if it is not in the plant. read_only: whether only reads and stops are allowed.
    """

    _inner = frozenset({"at_server", "config", "feeding", "own_error", "place", "request", "send"})

    def __init__(
        self,
        bus: LineOfServer,
        config: DriveConfig,
        *,
        said: Mapping[str, Any],
        known: DriveConfig | None,
        read_only: bool,
    ) -> None:
        self._bus = bus
        self.config = config
        self._said = dict(said)
        self._known = known
        self._read_only = read_only
        self._reason = f"{config} is read-only; leave read_only=True out to write or command it" if read_only else ""
        self.lease = ""
        """Key of the lease for commands; empty if each command acquires a lease of its own."""
        if known is None or said:
            # Options that differ from the server's plant are checked immediately, as on any bus.
            self._make()

    @property
    def server(self) -> LocalServer:
        """Server that owns the drive's line."""
        return self._bus.server

    @property
    def name(self) -> str:
        """Name of the drive on the command line, such as "vabus:1"."""
        return str(self.config)

    @property
    def machine(self) -> MachineUnit | None:
        """Unit of the speed of the drive's machine; None if it is not defined."""
        return self.config.machine

    @property
    def place(self) -> str:
        """Path of the drive in the server's interface."""
        from urllib.parse import quote

        if self._known is not None:
            return f"/api/v1/drives/{quote(self._known.name, safe='')}"
        return f"/api/v1/lines/{quote(self._bus.line, safe='')}/drives/{quote(str(self.config), safe=':*')}"

    @property
    def read_only_reason(self) -> str:
        """Error text for writes and commands; empty for a drive that is not read-only."""
        return self._reason

    @read_only_reason.setter
    def read_only_reason(self, reason: str) -> None:
        if not self._read_only:
            raise UsageError(f"{self.name} is not read-only; make it with read_only=True", says="read_only=True")
        self._reason = reason
        if "_exchanges" in vars(self) and isinstance(self._exchanges.operations, ReadOnly):
            self._exchanges.operations.reason = reason

    @property
    def is_in_plant(self) -> bool:
        """Whether the drive is in the plant of its server."""
        return self._known is not None

    def feeding(self, policy: LinkLoss, watchdog_s: Decimal, on_leaving: Stop | None) -> Feeding:
        """Return the keeper of its motor: a lease, so that the server stops the motor if this program dies."""
        from drivecomm.client.drive_lease import LeaseFeeding

        return LeaseFeeding(self, policy, watchdog_s, on_leaving)

    def at_server(self, do: Callable[[], Any]) -> Any:
        """Run a request to the server; awaitable on an asyncio bus."""
        return self._bus.at_server(do)

    def watched(self, silence_s: float | None) -> None:
        """Do nothing, because the server feeds only the watchdogs of motors that it keeps itself."""

    def send(self, verb: str, arguments: dict[str, Any], job: Callable[[], Job[Any]]) -> Any:
        """Run a verb at the server."""
        if self._read_only and verb not in READING and verb != "stop":
            job()
            # A verb of the protocol may only read; a server that treats the drive as read-only decides about it.
            if verb != "call" or (self._known is not None and self._known.armed):
                raise ReadOnlyError(self._reason)
        if verb == "set_reference" and arguments.get("machine") is not None:
            # The conversion uses the machine unit of this program, whatever plant file the server has read.
            job()
            arguments = {"hz": self._exchanges.references.machine_hz(arguments["machine"])}
        if not all(map(_can_be_sent, arguments.values())):
            job()
            raise UsageError(f"{verb} of {self.name} has arguments that cannot be sent to a server; use plain values")
        try:
            return self._bus.carry_out(self, verb, arguments)
        except UsageError:
            # The local check raises the same error in the words of other buses, if it fails as well.
            job()
            raise

    def request(self, arguments: Mapping[str, Any]) -> dict[str, Any]:
        """Return the content of a request, besides the verb."""
        armed = self._known is not None and self._known.armed
        return {
            "arguments": arguments,
            **({"options": self._said} if self._said else {}),
            **({"arm": True} if not self._read_only and not armed else {}),
            **({"lease": self.lease} if self.lease else {}),
        }

    def own_error(self, error: DriveCommError) -> DriveCommError:
        """Return the server's error in the words of this side."""
        return ReadOnlyError(self._reason) if isinstance(error, ReadOnlyError) and self._reason else error

    def __getattr__(self, name: str) -> Any:
        if name not in _MADE_LATER:
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        self._make()
        return vars(self)[name]

    def _make(self) -> None:
        made: DriveParts = self._bus.made_here(self.config, read_only=self._read_only)
        if isinstance(made.operations, ReadOnly):
            made.operations.reason = self._reason
        self._peer, self.model = made.peer, made.model
        self._exchanges = Exchanges(made.peer.name, made.operations, made.model, self.config.machine)


class RemoteBroadcastBase(RemoteCalls):
    """Base of `Broadcast` and `AsyncBroadcast` objects on a line that a server owns; made by the bus."""

    _inner = frozenset({"feeding", "own_error", "place", "request", "send"})

    _bus: LineOfServer
    _peer: Peer

    @property
    def place(self) -> str:
        """Path of the drives in the server's interface."""
        from urllib.parse import quote

        return f"/api/v1/lines/{quote(self._bus.line, safe='')}/drives/{self._peer.name}"

    def send(self, verb: str, arguments: dict[str, Any], job: Callable[[], Job[Any]]) -> Any:
        """Run a verb at the server."""
        job()
        return self._bus.carry_out(self, verb, arguments)

    def request(self, arguments: Mapping[str, Any]) -> dict[str, Any]:
        """Return the content of a request, besides the verb."""
        return {"arguments": arguments, "arm": True}

    def own_error(self, error: DriveCommError) -> DriveCommError:
        """Return the server's error unchanged."""
        return error


def _can_be_sent(value: object) -> bool:
    from decimal import Decimal
    from enum import Enum
    from math import isfinite

    if isinstance(value, float):
        return isfinite(value)
    if isinstance(value, list | tuple):
        return all(map(_can_be_sent, value))
    return value is None or isinstance(value, str | int | Decimal | Enum)
