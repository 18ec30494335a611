"""The Modbus TCP door that a `[[door]]` of a plant file configures."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING

from drivecomm.errors import UsageError
from drivecomm.line import STATUS
from drivecomm.server import Bounds, DoorHealth
from drivecomm.server.modbus_tcp.layout import FIXED_QUANTITIES, STATE_AT, number_type
from drivecomm.server.modbus_tcp.settings import check_plant, read_door_settings

if TYPE_CHECKING:
    from collections.abc import Callable, Sized

    from drivecomm.plant import Plant
    from drivecomm.protocol import DriveConfig
    from drivecomm.server import ServedPlant
    from drivecomm.tomlfile import TomlTable

_BOUNDS = Bounds(64, 32)


def modbus_tcp_door(table: TomlTable) -> ModbusTcpDoor:
    """Return the Modbus TCP door that a table of the plant file describes.

    Raises FileFormatError, or UsageError if pymodbus is not installed.
    """
    door = ModbusTcpDoor(table)
    try:
        # Before lines are polled: this import is slow in the door's thread while lines are busy.
        import_module("drivecomm.server.modbus_tcp.sessions")
    except ModuleNotFoundError as error:
        raise UsageError(
            f"a Modbus TCP door needs {error.name}, which is not installed; install drivecomm[modbus-tcp]"
        ) from None
    return door


class ModbusTcpDoor:
    """Door that serves Modbus TCP on a port."""

    def __init__(self, table: TomlTable) -> None:
        self._table = table
        self.settings = read_door_settings(table)
        self.connections = _BOUNDS
        self._clients: Sized = ()

    @property
    def name(self) -> str:
        """Name of the door in callers and events."""
        return f"modbus-tcp {self.settings.listen}"

    @property
    def port(self) -> int:
        """TCP port of the door, once it is open."""
        return self.settings.listen.port

    def check_plant(self, plant: Plant) -> None:
        """Raise FileFormatError if the table names a drive, or a value of a drive, that is not in the plant."""
        check_plant(self._table, self.settings, plant)

    def address_of(self, _plant: str, drive: DriveConfig, name: str) -> str:
        """Return the unit of a value, the address of its first register, counted from 0, and its type."""
        unit = next((unit for unit, each in self.settings.units.items() if each == drive.name), None)
        if unit is None:
            return ""
        own = {each.name: (each.address, each.type) for each in self.settings.registers.get(drive.name, ())}
        fixed = {each: (address, number_type(each)) for address, each in FIXED_QUANTITIES}
        address, kind = {**fixed, STATUS: (STATE_AT, "uint16"), **own}.get(name, (None, ""))
        return "" if address is None else f"unit {unit} register {address} {kind}"

    def health(self) -> DoorHealth:
        """Return the health of the door, with its number of connected clients."""
        return DoorHealth(clients=len(self._clients))

    async def run(self, plant: ServedPlant, opened: Callable[[], None]) -> None:
        """Serve until cancelled. Raises PortError."""
        from drivecomm.server.modbus_tcp.connections import Connections
        from drivecomm.server.modbus_tcp.sessions import ModbusSession, Units

        listening = self.settings.listen.open()
        # Port 0 means any free port; the name has to show which one it became.
        open_at = replace(self.settings.listen, port=listening.getsockname()[1])
        self.settings = replace(self.settings, listen=open_at)
        units = Units(plant, self.settings, self.name)
        with listening:
            may_command = self.settings.may_command if self.settings.commands_from else None
            connections = Connections(partial(ModbusSession, units), may_command, bounds=self.connections)
            self._clients = connections
            await connections.serve(listening, opened)
