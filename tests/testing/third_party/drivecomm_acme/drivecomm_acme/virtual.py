"""Virtual Acme drive, A10 line manual, sections 3 and 4."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.errors import ParameterAddressError
from drivecomm.protocol import Damaged, Framed, LineSettings, Motor, MotorCommand, VirtualReply
from drivecomm_acme import words
from drivecomm_acme.parameters import number_of, physical
from drivecomm_acme.telegrams import (
    ALL_DRIVES,
    Accepted,
    AcmeCodec,
    Order,
    Poll,
    Preset,
    Query,
    Refusal,
    Reply,
    Request,
    State,
    Value,
)

if TYPE_CHECKING:
    from drivecomm.protocol import Model
    from drivecomm_acme.options import AcmeOptions

_REFERENCE, _RAMP_UP, _RAMP_DOWN, _FREQUENCY, _CURRENT, _FAULT = "001", "010", "011", "100", "101", "110"


class VirtualAcmeDrive:
    """Virtual Acme drive: parameters, a control word, a motor. It does not answer damaged telegrams (section 2.4)."""

    def __init__(self, address: int, options: AcmeOptions, model: Model) -> None:
        self.address = address
        self.codec = AcmeCodec()
        self.settings = LineSettings(baudrate=19200)
        self.gap_s = 0.02
        self.motor = Motor()
        self._delay_s = options.reply_delay_s
        self._model = model
        self._infos = model.parameters
        self._words = {
            address: int((info.start or 0) / info.factor) & 0xFFFF
            for address, info in self._infos.items()
            if not isinstance(info.start, str)
        }
        self._stored = dict(self._words)
        self._control = 0

    def hear(self, find: Framed | Damaged, now: float) -> VirtualReply | None:
        """Act on a valid telegram for this drive or all drives; answer it if it is for this drive alone."""
        if isinstance(find, Damaged):
            return None
        request = find.message
        if not isinstance(request, Query | Preset | Poll | Order) or request.address not in (self.address, ALL_DRIVES):
            return None
        self.motor.advance(now)
        reply = self._reply(request, now)
        if request.address == ALL_DRIVES:
            return None
        return VirtualReply(data=self.codec.encode(reply), delay_s=self._delay_s)

    def peek(self, parameter: str, now: float) -> int:
        """Return a parameter's word as a read would, by address or name. Raises ParameterAddressError."""
        self.motor.advance(now)
        address = self._held(parameter)
        measured = {
            _FREQUENCY: round(self.motor.output_hz * 100),
            _CURRENT: round(self.motor.current_a * 10),
            _FAULT: self.motor.fault,
        }
        return measured.get(address, self._words[address]) & 0xFFFF

    def poke(self, parameter: str, raw: int | str) -> None:
        """Set a word as if at the keypad, by address or name. Raises ParameterAddressError."""
        address = self._held(parameter)
        self._words[address] = self._stored[address] = int(raw) & 0xFFFF

    def power_cycle(self, now: float) -> None:
        """Switch mains off and on: values that are not stored, the command and the fault are lost (section 3.2)."""
        self.motor.stop(MotorCommand.OFF, now)
        self.motor.reset(now)
        self._words, self._control = dict(self._stored), 0

    def trip(self, code: int, now: float) -> None:
        """Trip with a fault, 1 to 255."""
        self.motor.trip(code, now)

    def _held(self, parameter: str) -> str:
        number, _ = number_of(parameter, self._model)
        address = f"{number:03}"
        if address not in self._words:
            raise ParameterAddressError(f"the virtual drive holds no parameter {parameter!r}")
        return address

    def _reply(self, request: Request, now: float) -> Reply:
        if isinstance(request, Poll):
            return State(address=self.address, status_word=self._status_word(), fault_code=self.motor.fault & 0xFF)
        parameter = 0 if isinstance(request, Order) else request.parameter
        code = self._refusal(request, f"{parameter:03}")
        if code:
            return Refusal(address=self.address, of=request.kind, parameter=parameter, code=code)
        if isinstance(request, Order):
            self._take(request.control_word, now)
            return Accepted(address=self.address, control_word=request.control_word)
        if isinstance(request, Preset):
            self._words[f"{parameter:03}"] = request.data
            if request.kind == "store":
                self._stored[f"{parameter:03}"] = request.data
            if f"{parameter:03}" == _REFERENCE:
                self._turn(now)
        held = self.peek(f"{parameter:03}", now)
        return Value(kind=request.kind, address=self.address, parameter=parameter, data=held)

    def _refusal(self, request: Query | Preset | Order, parameter: str) -> int:
        if isinstance(request, Order):
            return words.IN_FAULT if self.motor.fault and request.control_word & words.RUN else 0
        info = self._infos.get(parameter)
        if info is None or parameter not in self._words:
            return words.UNKNOWN
        if isinstance(request, Query):
            return 0
        if info.access == "r":
            return words.READ_ONLY
        if info.access == "rw*" and self.motor.running:
            return words.RUNS
        value = physical(info, request.data)
        low = info.minimum is not None and value < info.minimum
        high = info.maximum is not None and value > info.maximum
        return words.OUT_OF_RANGE if low or high else 0

    def _take(self, control: int, now: float) -> None:
        before, self._control = self._control, control
        if control & words.RESET and not before & words.RESET:
            self.motor.reset(now)
        self._turn(now)

    def _turn(self, now: float) -> None:
        """Update the motor from control word, reference and ramps."""
        motor = self.motor
        motor.ramp_up_s, motor.ramp_down_s = self._words[_RAMP_UP] / 10, self._words[_RAMP_DOWN] / 10
        if self._control & words.COAST:
            motor.stop(MotorCommand.OFF, now)
        elif self._control & words.QUICK:
            motor.stop(MotorCommand.QUICK_STOP, now)
        elif self._control & words.RUN:
            hertz = self._words[_REFERENCE] / 100
            motor.run(-hertz if self._control & words.REVERSE else hertz, now)
        else:
            motor.stop(MotorCommand.RAMP_STOP, now)

    def _status_word(self) -> int:
        motor = self.motor
        return (
            words.RUNNING * motor.running
            | words.BACKWARDS * (motor.output_hz < 0)
            | words.FAULT * bool(motor.fault)
            | words.AT_REFERENCE * motor.at_reference
            | words.STOPPING * (motor.command is MotorCommand.QUICK_STOP)
        )
