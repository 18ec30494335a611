"""How a Huanyang drive answers."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.errors import ParameterAddressError
from drivecomm.profiles import RegisterMachine, RegisterRefusal
from drivecomm.protocol import Command, Damaged, Framed, LineSettings, Motor, VirtualReply
from drivecomm_huanyang import parameters as pd, telegrams as fn
from drivecomm_huanyang.telegrams import HuanyangCodec, Reply, Request

if TYPE_CHECKING:
    from drivecomm.profiles import Target
    from drivecomm.protocol import Model
    from drivecomm_huanyang.options import HuanyangOptions


class VirtualHuanyangDrive:
    """A drive at one address. It obeys the line where PD001 says so, and has a motor that PD005 limits."""

    def __init__(self, address: int, options: HuanyangOptions, model: Model) -> None:
        self.address = address
        self.codec = HuanyangCodec()
        self.settings = LineSettings()
        self.gap_s = 0.050
        self.motor = Motor()
        self._options, self._model = options, model
        targets = {each: pd.target(each, model) for each in model.parameters}
        self._machine = RegisterMachine(model, targets, pd.CONTROL, self.motor, {})
        # What happens to a drive beside its telegrams: time, a fault, which only its display tells, mains off and on.
        self.follow, self.trip, self.power_cycle = self._live, self.motor.trip, self._machine.power_cycle

    def hear(self, find: Framed | Damaged, now: float) -> VirtualReply | None:
        """Act on a telegram: silence for what is broken or not for this drive."""
        self._live(now)
        request = None if isinstance(find, Damaged) else find.message
        if not isinstance(request, Request) or request.address not in (self.address, fn.BROADCAST):
            return None
        try:
            reply = self._answer(request, now)
        except RegisterRefusal:
            reply = self._reply(fn.REFUSED, request.parameter)
        if request.address == fn.BROADCAST:
            return None
        return VirtualReply(data=self.codec.encode(reply), delay_s=self._options.reply_delay_s)

    def peek(self, parameter: str, now: float) -> int | str:
        """Return what a read would get."""
        self._live(now)
        return self._machine.fetch(self._known(parameter))

    def poke(self, parameter: str, raw: int | str) -> None:
        """Set what a parameter holds, as if at the keypad."""
        self._machine.put(self._known(parameter), int(raw))

    def _known(self, parameter: str) -> Target:
        found = pd.target(parameter, self._model)
        if found.place.name not in self._machine.words:
            raise ParameterAddressError(f"the virtual drive holds no parameter {parameter!r}")
        return found

    def _live(self, now: float) -> None:
        self.motor.maximum_hz = float(self._machine.words["5"] * pd.STEP_HZ)
        self._machine.live(now)

    def _answer(self, request: Request, now: float) -> Reply:
        function, number = request.function, request.parameter
        if function == fn.CONTROL:
            return self._control(request.value or 0, now)
        if function == fn.FREQUENCY:
            self._machine.write(["i0"], [request.value or 0], now)
            return self._reply(function, None, request.value, length=2)
        if function == fn.WRITE:
            self._machine.write([str(number)], [request.value or 0], now)
            return self._reply(function, number, request.value, length=request.length)
        (value,) = self._machine.read([f"i{number}" if function == fn.STATUS else str(number)])
        info = self._model.find(f"PD{number:03d}") if function == fn.READ else None
        is_byte = info is not None and info.extra.get("bytes") == 1
        return self._reply(function, number, value, length=2 if is_byte else 3)

    def _control(self, word: int, now: float) -> Reply:
        is_obeyed = self._machine.words["1"] in pd.NEEDS_TO_START["PD001"]
        if is_obeyed:
            self._machine.write([pd.CONTROL_PLACE], [word], now, only_ram=True)
        return self._reply(fn.CONTROL if is_obeyed else fn.CONTROL_REFUSED, None, self._status_byte())

    def _status_byte(self) -> int:
        """Return CNST: run, jog, r/f as commanded, running, jogging, r/f as it turns (p. 62)."""
        motor = self.motor
        says = (motor.command is Command.RUN, False, motor.target_hz < 0, motor.running, False, motor.output_hz < 0)
        return sum(holds << bit for bit, holds in enumerate(says))

    def _reply(self, function: int, parameter: int | None, value: int | None = None, *, length: int = 1) -> Reply:
        return Reply(address=self.address, function=function, length=length, parameter=parameter, value=value)
