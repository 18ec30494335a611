"""One connection of a door and its responses."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from drivecomm.errors import UsageError
from drivecomm.server import Caller, CommandRequest, Role
from drivecomm.server.modbus_tcp.commanding import RegisterCommander
from drivecomm.server.modbus_tcp.layout import COMMANDS_END, RESULTS_END, STOP_AT
from drivecomm.server.modbus_tcp.reading import UnitRegisters
from drivecomm.server.modbus_tcp.refusals import Refusals
from drivecomm.server.modbus_tcp.register_image import SIZE, RegisterImage
from drivecomm.server.modbus_tcp.requests import (
    ExceptionCode,
    RefusedRequest,
    encode_exception,
    encode_response,
    parse_request,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivecomm.server import ServedPlant
    from drivecomm.server.modbus_tcp.requests import RegisterRequest
    from drivecomm.server.modbus_tcp.settings import DoorSettings

_log = logging.getLogger("drivecomm.server.modbus_tcp")

_LEFT_MOST = 0xFFFF


class Units:
    """All units of a door, shared by its connections. name: name of the door."""

    def __init__(self, plant: ServedPlant, settings: DoorSettings, name: str) -> None:
        self.plant, self.settings, self.name = plant, settings, name
        self.registers = {
            unit: UnitRegisters(drive, settings.registers.get(drive, ()), plant)
            for unit, drive in settings.units.items()
        }
        self.refusals = Refusals(plant)
        self.commanders = {
            unit: RegisterCommander(
                plant, drive, Caller(name="", role=Role.OPERATE, door=name), settings.lease_s, self.refusals
            )
            for unit, drive in settings.units.items()
        }

    def note_stranger(self, address: str, unit: int, asked: RegisterRequest) -> None:
        """Record in the audit that an address without permission tried to command."""
        caller = Caller(name=address, role=Role.VIEW, door=self.name)
        words = " ".join(f"{word:04X}" for word in asked.written)
        command = CommandRequest(
            drive=self.settings.units[unit], verb="write", arguments={"register": asked.write_at, "words": words}
        )
        self.refusals.note(caller, command, "commands_from of the door does not list this address")


class ModbusSession:
    """Responses on one connection. address: address of the peer."""

    def __init__(self, units: Units, address: str) -> None:
        self._units, self._address = units, address
        self._may_command = units.settings.may_command(address)
        self._images: dict[int, RegisterImage] = {}

    def answer(self, unit: int, telegram: bytes) -> bytes:
        """Return the response to a telegram; both start with the function code."""
        try:
            return self._answer(unit, telegram)
        except RefusedRequest as refused:
            return encode_exception(telegram, refused.code)
        except Exception:  # noqa: BLE001 - whoever asks is answered
            _log.exception("unit %d", unit)
            return encode_exception(telegram, ExceptionCode.FAILURE)

    def closed(self) -> None:
        """Release the stops of the connection. Its lease expires unless its address connects again."""
        for image in self._images.values():
            image.is_connected = False
            image.release_stop()

    def _answer(self, unit: int, telegram: bytes) -> bytes:
        if unit not in self._units.registers:
            raise RefusedRequest(ExceptionCode.NO_PATH)
        asked = parse_request(telegram)
        words: Sequence[int] = ()
        if asked.written:
            self._write(unit, asked)
        if asked.read_count:
            words = self._read(unit, asked.read_at, asked.read_count)
        return encode_response(asked, words)

    def _write(self, unit: int, asked: RegisterRequest) -> None:
        if not self._units.settings.commands_from:
            raise RefusedRequest(ExceptionCode.FUNCTION)
        if not self._may_command:
            self._units.note_stranger(self._address, unit, asked)
            raise RefusedRequest(ExceptionCode.FUNCTION)
        commander = self._units.commanders[unit]
        image = self._images.get(unit)
        if image is None:
            image = self._images[unit] = RegisterImage(self._address)
        commander.write(image, asked.write_at, asked.written)

    def _read(self, unit: int, address: int, count: int) -> Sequence[int]:
        if address < STOP_AT or not self._units.settings.commands_from:
            return self._units.registers[unit].read(address, count)
        end = address + count
        middle = COMMANDS_END - 1
        if end > RESULTS_END or middle in (address, end):
            raise RefusedRequest(ExceptionCode.ADDRESS)
        return self._command_words(unit)[address - STOP_AT : end - STOP_AT]

    def _command_words(self, unit: int) -> list[int]:
        commander = self._units.commanders[unit]
        told, image = commander.results_of(self._address), self._images.get(unit)
        lease, left = self._lease(unit)
        return [
            *(image.words if image is not None else [0] * SIZE),
            told.answered,
            told.command.outcome,
            told.command.reason,
            lease,
            left,
            told.reference.outcome,
            told.reference.reason,
            commander.stop_outcome(self._address),
        ]

    def _lease(self, unit: int) -> tuple[int, int]:
        """Return the content of the lease register, and how long this address still has the lease, in 0.1 s."""
        held = self._units.commanders[unit].lease
        if held.owner is not None and held.owner.address == self._address and held.left_s > 0:
            return 1, min(_LEFT_MOST, int(held.left_s * 10))
        try:
            holder = self._units.plant.drive(self._units.settings.units[unit]).lease
        except UsageError:
            raise RefusedRequest(ExceptionCode.NO_PATH) from None
        return (0 if holder is None else 2), 0
