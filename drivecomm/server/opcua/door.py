"""The OPC UA door that a `[[door]]` of a plant file configures."""

from __future__ import annotations

from functools import partial
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING

from drivecomm.errors import UsageError
from drivecomm.server import DoorHealth, door_access_keys, read_door_access
from drivecomm.server.opcua.limits import CONNECTIONS
from drivecomm.tomlfile import Kind

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.protocol import DriveConfig
    from drivecomm.server import ServedPlant
    from drivecomm.server.opcua.serving import OpcuaService
    from drivecomm.tomlfile import TomlTable

_DEFAULT = "127.0.0.1:4840"
_FOLDER = Kind((str,), "the path of a folder in quotes")


def opcua_door(table: TomlTable) -> OpcuaDoor:
    """Return the OPC UA door that a table of the plant file describes. Raises FileFormatError and UsageError."""
    return OpcuaDoor(table)


class OpcuaDoor:
    """Door that serves OPC UA on a TCP port. Raises UsageError if asyncua is not installed."""

    def __init__(self, table: TomlTable) -> None:
        if find_spec("asyncua") is None:
            raise UsageError("the OPC UA door needs asyncua, which is not installed; install drivecomm[opcua]")
        # Imported here, because the import is slow in a thread while lines are polled.
        import_module("drivecomm.server.opcua.serving")
        given = table.take({**door_access_keys(_DEFAULT), "trusted": _FOLDER})
        self._way_in = read_door_access(table, given, _DEFAULT)
        self._trusted = table.beside(given["trusted"]) if "trusted" in given else None
        if self._trusted is not None and self._way_in.certificate is None:
            raise table.error(
                "clients present certificates on encrypted channels only; write certificate = and key =", "trusted"
            )
        self._listen = given.get("listen", _DEFAULT)
        self.port = 0
        self.connections = CONNECTIONS
        self._served: OpcuaService | None = None

    @property
    def name(self) -> str:
        """Name of the door in callers and events."""
        return f"opcua {self._listen}"

    def health(self) -> DoorHealth:
        """Return the health of the door, with its number of connected clients."""
        return DoorHealth(clients=0 if self._served is None else len(self._served.clients))

    def address_of(self, _plant: str, drive: DriveConfig, name: str) -> str:
        """Return the node id of a value. Our namespace follows those of the standard and of the server."""
        from drivecomm.server.opcua.naming import value_path

        return f"ns=2;s={'/'.join(value_path(drive.name, name))}"

    async def run(self, plant: ServedPlant, opened: Callable[[], None]) -> None:
        """Serve until cancelled. Raises UsageError and PortError."""
        # Imported here, because both modules import asyncua, which is slow and optional.
        from drivecomm.server.opcua.serving import OpcuaService, read_certificate, serve
        from drivecomm.server.opcua.trusted import TrustedClients

        self._way_in.check_users(self.name, plant.users)
        anonymous = self._way_in.shows_strangers(plant.users)
        if plant.users is None and not anonymous:
            raise UsageError(
                f'{self.name} admits no clients; write users = ... in [server], or anonymous = "view" in its [[door]]'
            )
        files = self._way_in.certificate
        certificate = read_certificate(self.name, *files) if files else None
        trusted = TrustedClients(self._trusted, partial(plant.tell, who=self.name)) if self._trusted else None
        with self._way_in.address.open() as listening:
            # Port 0 means any free port; the name has to show which one it became.
            self.port = listening.getsockname()[1]
            self._listen = f"{self._listen.rpartition(':')[0]}:{self.port}"
            self._served = OpcuaService(plant, self.name, anonymous=anonymous)
            await serve(
                self._served,
                opened,
                listening,
                self._listen,
                certificate=certificate,
                trusted=trusted,
                bounds=self.connections,
            )
