"""Settings of a Modbus TCP door: where it listens, the unit of each drive, and who may command.

[[door]]
kind = "modbus-tcp"
listen = "127.0.0.1:5020"
units = { pump = 1, fan = 2 }
registers = { pump = { "480" = 200, "status_word" = { address = 204, type = "uint32" } } }
commands_from = ["127.0.0.1"]
lease_s = 3
"""

from __future__ import annotations

import ipaddress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeAlias

from drivecomm.errors import suggestion
from drivecomm.server import ListenAddress, listen_address, listen_kind
from drivecomm.server.modbus_tcp.layout import FIRST_OWN, LAST_OWN, VALUE_WORDS, NumberType, OwnRegister, number_type
from drivecomm.tomlfile import CHOICE, LIST, SECONDS, TABLE, TEXT, Kind, TomlTable

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.plant import Plant

    Network: TypeAlias = ipaddress.IPv4Network | ipaddress.IPv6Network

_DEFAULT = "127.0.0.1:5020"
_KEYS = {
    "kind": TEXT,
    "listen": listen_kind(_DEFAULT),
    "units": Kind((dict,), "a number from 1 to 247 for each drive, such as { pump = 1, fan = 2 }"),
    "registers": TABLE,
    "insecure": CHOICE,
    "commands_from": LIST,
    "lease_s": SECONDS,
}
_TYPES: tuple[NumberType, ...] = ("float32", "uint32")
_REGISTER = {"address": Kind((int,), f"a number from {FIRST_OWN} to {LAST_OWN}"), "type": TEXT}
_LAST_UNIT = 247
_SHORTEST_LEASE_S, _LONGEST_LEASE_S = 0.5, 30.0


@dataclass(frozen=True, slots=True, kw_only=True)
class DoorSettings:
    """Settings of a Modbus TCP door.

    units: the drive of each unit. registers: further values of each drive, ordered by address. commands_from: addresses
    that may command drives. lease_s: seconds for which a heartbeat holds the lease.
    """

    listen: ListenAddress
    units: Mapping[int, str]
    registers: Mapping[str, tuple[OwnRegister, ...]] = field(default_factory=dict)
    commands_from: tuple[Network, ...] = ()
    lease_s: float = 3.0

    def may_command(self, address: str) -> bool:
        """Whether this address may command drives."""
        try:
            found = ipaddress.ip_address(address.partition("%")[0])
        except ValueError:
            return False
        plain = getattr(found, "ipv4_mapped", None) or found
        return any(plain in network for network in self.commands_from)


def read_door_settings(table: TomlTable) -> DoorSettings:
    """Return the settings from the table of a door. Raises FileFormatError."""
    given = table.take(_KEYS, "units")
    listen = listen_address(table, given.get("listen", _DEFAULT), _DEFAULT)
    if not (listen.is_loopback or given.get("insecure", False)):
        raise table.error(
            f"{listen} can be reached from the network, and Modbus TCP has no encryption and no users; listen on "
            "127.0.0.1, or set insecure = true",
            "listen",
        )
    lease_s = given.get("lease_s", 3.0)
    if not _SHORTEST_LEASE_S <= lease_s <= _LONGEST_LEASE_S:
        raise table.error(
            f"invalid lease_s = {lease_s:g}; write seconds from {_SHORTEST_LEASE_S:g} to {_LONGEST_LEASE_S:g}",
            "lease_s",
        )
    units = _units(table)
    return DoorSettings(
        listen=listen,
        units=units,
        registers=_registers(table, units),
        commands_from=tuple(_network(table, each) for each in given.get("commands_from", ())),
        lease_s=float(lease_s),
    )


def check_plant(table: TomlTable, settings: DoorSettings, plant: Plant) -> None:
    """Raise FileFormatError if the table names a drive, or a value of a drive, that is not in the plant."""
    drives = {drive.name: drive for drive in plant.drives}
    for unit, name in settings.units.items():
        if name not in drives:
            raise table.error(
                f"units: there is no drive {name!r} for unit {unit}; {suggestion(name, drives, 'the plant has')}",
                "units",
            )
    for name, own in settings.registers.items():
        polled = [parameter for group in drives[name].poll for parameter in group.parameters]
        for register in own:
            if register.name not in polled:
                raise table.error(
                    f"registers: {register.name} of {name} is not polled; write it under poll of the drive, too",
                    "registers",
                )


def _units(table: TomlTable) -> dict[int, str]:
    said = table.table("units")
    units: dict[int, str] = {}
    if not said.content:
        raise said.error(f"no drive is a unit; write units = {_KEYS['units'].words}", "units")
    for name, unit in said.content.items():
        if not isinstance(unit, int) or isinstance(unit, bool) or not 1 <= unit <= _LAST_UNIT:
            raise said.error(f"invalid {name} = {unit!r}; write a number from 1 to {_LAST_UNIT}", name)
        if unit in units:
            raise said.error(
                f"{units[unit]} and {name} cannot both be unit {unit}; give each a number of its own", name
            )
        units[unit] = name
    return dict(sorted(units.items()))


def _registers(table: TomlTable, units: Mapping[int, str]) -> dict[str, tuple[OwnRegister, ...]]:
    said = table.table("registers")
    found: dict[str, tuple[OwnRegister, ...]] = {}
    for drive in said.content:
        if drive not in units.values():
            raise said.error(f"{drive} is not a unit; {suggestion(drive, units.values(), 'units are')}", drive)
        of_drive = said.table(drive)
        places: dict[int, OwnRegister] = {}
        for name, place in of_drive.content.items():
            own = _own_register(of_drive, name, place)
            if own.address in places:
                raise of_drive.error(
                    f"{places[own.address].name} and {name} cannot both be at {own.address}; give each its own", name
                )
            places[own.address] = own
        found[drive] = tuple(places[address] for address in sorted(places))
    return found


def _own_register(table: TomlTable, name: str, place: Any) -> OwnRegister:
    number: Any = number_type(name)
    if isinstance(place, dict):
        given = table.table(name).take(_REGISTER, "address")
        place, number = given["address"], given.get("type", number)
        if number not in _TYPES:
            raise table.error(f"{name}: invalid type = {number!r}; write {' or '.join(map(repr, _TYPES))}", name)
    is_number = isinstance(place, int) and not isinstance(place, bool)
    if not is_number or not FIRST_OWN <= place <= LAST_OWN or place % VALUE_WORDS:
        raise table.error(
            f"invalid {name} = {place!r}; write a multiple of {VALUE_WORDS} from {FIRST_OWN} to {LAST_OWN}", name
        )
    return OwnRegister(name, place, number)


def _network(table: TomlTable, said: Any) -> Network:
    try:
        return ipaddress.ip_network(said if isinstance(said, str) else "")
    except ValueError:
        raise table.error(
            f'commands_from cannot hold {said!r}; write addresses, such as ["192.168.10.5", "192.168.11.0/24"]',
            "commands_from",
        ) from None
