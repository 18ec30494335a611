"""A virtual drive for the Danfoss FC protocol.

VLT 2800 Design Guide p. 108 (it answers only an error-free telegram for its address, and nothing else); specification,
sections 3 to 9 and 13.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.protocol import DriveRepr, Framed, LineSettings, Motor, Refusal, VirtualReply, looked_into
from drivecomm_danfoss_fc import access
from drivecomm_danfoss_fc.hearing import DriveCodec
from drivecomm_danfoss_fc.machine import Machine
from drivecomm_danfoss_fc.messages import (
    FORMAT_31,
    ParameterReply,
    ParameterRequest,
    ProcessReply,
    ProcessRequest,
    TextReply,
    TextRequest,
)
from drivecomm_danfoss_fc.parameters import target
from drivecomm_danfoss_fc.store import Store
from drivecomm_danfoss_fc.tables import NO_TEXT, NOT_SUPPORTED, table

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.protocol import Damaged, Model
    from drivecomm_danfoss_fc.messages import Request
    from drivecomm_danfoss_fc.options import DanfossFcOptions

_REFUSED = 7
_LOG_PLACES = 10


class VirtualDanfossFcDrive(DriveRepr):
    """A drive at one address: parameter store, effects of the control word, motor.

    Tests may change store and machine: `machine.local`, `machine.locked`, `store.without_bus_access` and so on.
    """

    def __init__(self, address: int, options: DanfossFcOptions, model: Model) -> None:
        self.address = address
        self.codec = DriveCodec(options.pnu_bits)
        self.settings = LineSettings(baudrate=9600, bytesize=8, parity="E", stopbits=1)
        self.gap_s = 0.050
        self.motor = Motor()
        self.store = Store(model, options.index_base)
        self.machine = Machine(self.motor, self.store, options)
        self._model = model
        self._options = options
        self._logged = 0
        for name in ("rated_hz", "rated_v", "rated_a", "rated_kw", "rated_rpm"):
            setattr(self.motor, name, self.store.setting(name, getattr(self.motor, name)))
        self._counted = {role: int(self.store.setting(role, 0)) for role in ("hours", "running_hours", "energy")}
        self.store.measure(self.motor, self._measured())
        self.store.show("address", address)
        if options.profile == "profidrive":
            self.store.show("profile", 1 - self.store.fact("profile", "fc_value", 0))

    def hear(self, find: Framed | Damaged, now: float) -> VirtualReply | None:
        """Act on a telegram; stay silent for a damaged one, for one to another drive, and for a broadcast."""
        self.follow(now)
        if not isinstance(find, Framed):
            return None
        message = find.message
        if not isinstance(message, ProcessRequest | ParameterRequest | TextRequest) or not self._means_us(message):
            return None
        status, actual = self.machine.status_word(), self.machine.main_actual()
        reply = self._reply(message, status, actual)
        self.machine.control(message.control_word, message.reference, now)
        if message.broadcast:
            return None
        return VirtualReply(data=_addressed_as(find.data, self.codec.encode(reply)), delay_s=self._delay_s())

    def peek(self, parameter: str, now: float) -> int | str:
        """Return the unsigned number or the text that a read would return."""
        self.follow(now)
        wanted = target(parameter, self._model, self._options)
        with looked_into(parameter):
            return self.store.peek(wanted.pnu, wanted.index)

    def poke(self, parameter: str, raw: int | str) -> None:
        """Set the value of a parameter, which also replaces its measurement."""
        wanted = target(parameter, self._model, self._options)
        with looked_into(parameter):
            self.store.poke(wanted.pnu, wanted.index, raw)

    def trip(self, code: int, now: float) -> None:
        """Trip: switch the output off, and add the code at the front of the alarm log."""
        self.follow(now)
        self.motor.trip(code, now)
        self.follow(now)

    def power_cycle(self, now: float) -> None:
        """Switch mains off and on: RAM values, control word, trip and trip lock are lost."""
        self.follow(now)
        self.store.power_cycle()
        self.motor.stop(self.motor.command.OFF, now)
        self.motor.reset(now)
        self.motor.warning = False
        self.machine.locked = False
        self.machine.power_up()
        self.store.show("power_ups", self.store.setting("power_ups", 0) + 1)

    def follow(self, now: float) -> None:
        """Advance the time, and log a trip of the motor."""
        self.machine.watch(now)
        fault = self.motor.fault
        if fault != self._logged:
            self._logged = fault
            if fault:
                self._log(fault, now)

    def _means_us(self, message: Request) -> bool:
        if message.broadcast:
            return True
        return message.address == self.address and (message.address_format != FORMAT_31 or self.address < 32)

    def refusing(self, find: Framed, code: int, now: float) -> VirtualReply | None:
        """Refuse the parameter access of a telegram; its control word is obeyed."""
        message = find.message
        if not isinstance(message, ParameterRequest | TextRequest) or message.broadcast:
            return None
        self.follow(now)
        shared = self._shared(message, self.machine.status_word(), self.machine.main_actual())
        self.machine.control(message.control_word, message.reference, now)
        reply = ParameterReply(**shared, ak=_REFUSED, pnu=message.pnu, ind=message.ind, pwe=code)
        return VirtualReply(data=_addressed_as(find.data, self.codec.encode(reply)), delay_s=self._delay_s())

    def _shared(self, message: Request, status: int, actual: int) -> dict[str, Any]:
        return {
            "address_format": message.address_format,
            "address": self.address,
            "status_word": status,
            "main_actual": actual,
        }

    def _reply(self, message: Request, status: int, actual: int) -> ProcessReply | ParameterReply | TextReply:
        shared = self._shared(message, status, actual)
        if isinstance(message, ProcessRequest):
            return ProcessReply(**shared)
        try:
            ak, content = self._answer(message)
        except Refusal as refusal:
            ak, content = _REFUSED, refusal.code
        if isinstance(content, str):
            return TextReply(**shared, ak=ak, pnu=message.pnu, ind=message.ind, text=content)
        return ParameterReply(**shared, ak=ak, pnu=message.pnu, ind=message.ind, pwe=content)

    def _answer(self, message: ParameterRequest | TextRequest) -> tuple[int, int | str]:
        """Return response code and value or text. Raises Refusal.

        The high byte of IND counts only with AK 4 and 15. The response codes of numbers are 1 and 2, which is the
        number of their words.
        """
        store, number, low, high = self.store, message.pnu, message.ind & 0xFF, message.ind & 0xFF00
        if isinstance(message, TextRequest):
            if not self._options.text_writes:
                raise Refusal(NOT_SUPPORTED)
            store.write_text(number, low, message.text, running=self.motor.running)
            return access.TEXT, message.text
        if message.ak == 0:
            return 0, 0
        if message.ak == access.READ:
            return store.fetch(number, low)
        known = table("commands").get(message.ak, {})
        if "bits" in known:
            running, stored = self.motor.running, known["stored"]
            return store.write(number, low, known["bits"], message.pwe, store=stored, running=running)
        if message.ak == access.READ_ELEMENT:
            return 3, store.describe(number, message.ind)
        if message.ak != access.TEXT:
            raise Refusal(NOT_SUPPORTED)
        if high == access.READ_TEXT:
            return access.TEXT, store.read_text(number, low)
        if high or not low:
            raise Refusal(NO_TEXT)
        return access.TEXT, store.option_text(number, low - 1)

    def _delay_s(self) -> float:
        """Return the delay of a reply: two characters, or 8-35 if that is longer (specification, section 13)."""
        minimum_s = self.store.setting("response_delay", 0) / 1000
        return max(2 * self.settings.character_s, minimum_s, self._options.reply_delay_s)

    def _measured(self) -> dict[str, Callable[[], float]]:
        """Return by role the functions for further values that are measured when they are read."""
        machine, motor, counted = self.machine, self.motor, self._counted
        return {
            "seen_control_word": lambda: machine.word,
            "port_control_word": lambda: machine.word,
            "port_reference": lambda: machine.reference,
            "seen_reference": lambda: motor.target_hz,
            "seen_reference_percent": machine.reference_percent,
            "status_word": machine.status_word,
            "actual_percent": lambda: machine.main_actual() * 100 / machine.full,
            "torque_nm": lambda: motor.torque_nm,
            "speed": lambda: motor.speed_rpm,
            "relay_outputs": lambda: machine.relays[0] + 2 * machine.relays[1],
            "hours": lambda: counted["hours"] + motor.time // 3600,
            "running_hours": lambda: counted["running_hours"] + motor.running_s // 3600,
            "alarm_and_warning": lambda: motor.fault << 8,
            "energy": lambda: counted["energy"] + motor.energy_kwh // 1,
        }

    def _log(self, code: int, now: float) -> None:
        """Add a trip at the front of the alarm log: code, value, time."""
        for role, newest in (("log_code", float(code)), ("log_value", 0.0), ("log_time", now)):
            if self.store.has(role):
                older = [self.store.setting(role, 0, place) for place in range(_LOG_PLACES - 1)]
                for place, value in enumerate([newest, *older]):
                    self.store.show(role, value, place)


def _addressed_as(request: bytes, reply: bytes) -> bytes:
    """Return a reply with the ADR of its request, including bit 6, which format 1-31 does not use (seed 001)."""
    return reply[:2] + request[2:3] + reply[3:-1] + bytes([reply[-1] ^ reply[2] ^ request[2]])
