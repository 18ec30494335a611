"""How a USS drive answers (USS specification A-8, A-9, C-15, C-26 to C-31; MICROMASTER 420 Reference Manual p. 46-49).

What no page says is chosen: the control word acts before nothing but the reply; ON needs an edge; a broadcast is obeyed
with the bits that it lets through.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.errors import ParameterAddressError
from drivecomm.protocol import Command, Framed, LineSettings, Motor, VirtualReply
from drivecomm_uss import parameter_words, words
from drivecomm_uss.messages import Reply, Request
from drivecomm_uss.parameters import PAGE, RANGES, Target, float_bits, raw_for, shortest_decimal, target
from drivecomm_uss.telegrams import UssCodec
from drivecomm_uss.words import has

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.protocol import Damaged, Model, ParameterInfo
    from drivecomm_uss.options import UssOptions

NO_NUMBER, READ_ONLY, LIMIT, NO_INDEX, NO_ARRAY, WRONG_TYPE, WHILE_RUNNING, NO_TASK = 0, 1, 2, 3, 4, 5, 17, 106
SILENT, NO_CONTROL = 70, 7220
"""Faults: telegram off time over (F0070), control by the master lost while running (F07220)."""

_WIDTH = {2: 16, 7: 16, 12: 16, 14: 16, 3: 32, 8: 32, 11: 32, 13: 32}
_IN_ARRAY, _HIGH = (6, 7, 8, 11, 12), (11, 12, 13, 14)


class VirtualUssDrive:
    """A drive at one address: parameters, control word with its consequences, motor. store: raw values by address."""

    def __init__(self, address: int, options: UssOptions, model: Model) -> None:
        self.address = address
        self.codec = UssCodec(options)
        self.settings = LineSettings(baudrate=9600, bytesize=8, parity="E", stopbits=1)
        self.gap_s = 0.050
        self.motor = Motor()
        self._options = options
        self._model = model
        self._infos = {int(info.address): info for info in model.parameters.values()}
        self._roles = {str(info.extra["role"]): number for number, info in self._infos.items() if "role" in info.extra}
        self._eeprom = {
            (number, place): self._raw(info, info.start or 0)
            for number, info in self._infos.items()
            for place in self._places(info)
        }
        self._ram = dict(self._eeprom)
        self._poked: set[int] = set()
        self._fed_at: float | None = None
        self._measured: dict[str, Callable[[], float]] = {
            "output_hz": lambda: abs(self.motor.output_hz),
            "current": lambda: self.motor.current_a,
            "voltage": lambda: self.motor.voltage_v,
            "dc_link": lambda: self.motor.dc_link_v,
            "status_word": self._status_word,
            "fault": lambda: self.motor.fault,
        }
        self._ram_set("address", address)
        self._power_up()

    def hear(self, find: Framed | Damaged, now: float) -> VirtualReply | None:
        """Act on a telegram: silence for what is broken, not for this drive, or for all."""
        message = find.message if isinstance(find, Framed) else None
        if not isinstance(message, Request) or message.special:
            return None
        self.follow(now)
        if message.broadcast:
            if self._options.broadcast:
                self._obey_all(message, now)
            return None
        if message.address != self.address:
            return None
        reply: dict[str, Any] = {"data": message.data, "mirror": True} if message.mirror else self._answer(message)
        if not message.mirror:
            if self._options.pzd_words:
                reply["status_word"] = self._status_word()
            if self._options.pzd_words > 1:
                reply["actual"] = self._actual()
            if self._options.pzd_words > 2:
                reply["pzd"] = (0,) * (self._options.pzd_words - 2)
            self._control(message.control_word or 0, message.reference or 0, now)
        data = self.codec.encode(Reply(address=self.address, **reply))
        return VirtualReply(data=data, delay_s=self._options.reply_delay_s)

    def peek(self, parameter: str, now: float) -> int:
        """Return the unsigned number that a read would get."""
        self.follow(now)
        return self._held(*self._place(parameter))

    def poke(self, parameter: str, raw: int | str) -> None:
        """Set what a parameter holds; one that the drive measures is not measured any more."""
        number, index = self._place(parameter)
        self._poked.add(number)
        self._ram[number, index] = self._eeprom[number, index] = int(raw)

    def trip(self, code: int, now: float) -> None:
        """Trip with a fault."""
        self.follow(now)
        self.motor.trip(code, now)
        self._on = False

    def power_cycle(self, now: float) -> None:
        """Switch mains off and on: RAM values, process data and the fault are gone."""
        self.follow(now)
        self._ram = dict(self._eeprom)
        self.motor.stop(Command.OFF, now)
        self.motor.reset(now)
        self._power_up()

    def follow(self, now: float) -> None:
        """Let time pass, and trip when the telegram off time was over, which may be some time ago."""
        limit_s = self._set_to("off_time")
        if limit_s and self._fed_at is not None and now > self._fed_at + limit_s and not self.motor.fault:
            self.trip_at(SILENT, self._fed_at + limit_s)
        self.motor.advance(now)
        self._on = self._on and not self.motor.fault

    def trip_at(self, code: int, then: float) -> None:
        """Trip with a fault at a time that may be over."""
        self._fed_at = None
        self.motor.trip(code, then)

    def _power_up(self) -> None:
        self._word = self._hsw = 0
        self._on, self._inhibited, self._fed_at = False, True, None

    # The process data

    def _control(self, word: int, reference: int, now: float) -> None:
        """Obey a control word; without bit 10 the process data stay as they were."""
        motor = self.motor
        if not has(word, words.VALID):
            if self._options.running_needs_control and motor.running and self._word:
                self.trip_at(NO_CONTROL, now)
                self._on = False
            return
        self._fed_at = now
        before, self._word, self._hsw = self._word, word, reference
        self._ram_set("reference", reference & 0xFFFF, 1)
        if motor.fault:
            if has(word, words.ACKNOWLEDGE_BIT) and not has(before, words.ACKNOWLEDGE_BIT):
                motor.reset(now)
                self._on, self._inhibited = False, True
            return
        if not has(word, words.OFF2) or not has(word, words.OFF3):
            self._on, self._inhibited = False, True
            motor.stop(Command.OFF if not has(word, words.OFF2) else Command.QUICK_STOP, now)
        elif not has(word, words.ON):
            self._on = False
            self._inhibited = self._inhibited and motor.running
            if motor.command is not Command.QUICK_STOP:
                motor.stop(Command.RAMP_STOP, now)
        elif self._on or (not self._inhibited and not has(before, words.ON)):
            self._on = True
            self._run(word, now)

    def _run(self, word: int, now: float) -> None:
        if not has(word, words.ENABLE):
            self.motor.stop(Command.OFF, now)
        elif not has(word, words.RAMP_GOES):
            self.motor.stop(Command.HOLD, now)
        else:
            goes = has(word, words.RAMP) and has(word, words.SETPOINT)
            self.motor.run(self._hsw / words.HUNDRED_PERCENT * self._full_hz() * self._sign(word) * goes, now)

    def _sign(self, word: int) -> int:
        options = self._options
        if options.reverse_bit >= 0 and has(word, options.reverse_bit):
            return -1
        return 1 if options.right_bit < 0 or has(word, options.right_bit) else 0

    def _obey_all(self, message: Request, now: float) -> None:
        enable, word, reference = message.enable, message.control_word or 0, message.reference or 0
        if enable is not None:
            word = self._word & ~enable[1] | word & enable[1] if enable[0] & 2 else self._word
            reference = reference if enable[0] & 4 else self._hsw
        if has(self._word, words.VALID) or enable is None:
            self._control(word, reference, now)

    def _full_hz(self) -> float:
        """The frequency of 100 %."""
        return self._set_to("full_hz") or float(self._options.hertz or 50)

    def _set_to(self, role: str) -> float:
        """Return what the parameter with this role holds, physically, 0 where there is none."""
        number = self._roles.get(role)
        if number is None:
            return 0.0
        info = self._infos[number]
        return float(self._shown(info, self._ram[number, self._places(info)[0]]) or 0)

    def _actual(self) -> int:
        return max(-(2**15), min(2**15 - 1, round(self.motor.output_hz / self._full_hz() * words.HUNDRED_PERCENT)))

    def _status_word(self) -> int:
        motor, fault = self.motor, bool(self.motor.fault)
        off2, off3 = self._word and not has(self._word, words.OFF2), self._word and not has(self._word, words.OFF3)
        bits = (
            (not fault and not self._inhibited) or motor.running, self._on or motor.running, motor.running, fault,
            not off2, not off3, self._inhibited and not motor.running, motor.warning, motor.at_reference, True,
        )  # fmt: skip
        return sum(1 << bit for bit, on in enumerate(bits) if on)

    # Parameters

    def _answer(self, message: Request) -> dict[str, Any]:
        if not self._options.pkw_words:
            return {}
        names = ("pnu", "page", "index", "parameter_set")
        place = {name: getattr(message, name) for name in names}
        if not message.ak:
            return {"ak": 0, "pnu": 0}
        try:
            return {**place, **self._task(message)}
        except _Refusal as refusal:
            return {**place, "ak": parameter_words.IMPOSSIBLE, "error": refusal.code}

    def _task(self, message: Request) -> dict[str, Any]:
        ak = message.ak or 0
        number = (message.pnu or 0) + PAGE * (message.page or 0)
        info = self._infos.get(number)
        if info is None:
            raise _Refusal(NO_NUMBER)
        if ak == parameter_words.COUNT_ELEMENTS:
            return {"ak": 6, "value": len(self._places(info))}
        if ak not in (parameter_words.READ, parameter_words.READ_ELEMENT, *_WIDTH):
            raise _Refusal(NO_TASK)
        index, array = message.index or 0, "elements" in info.extra
        if ak in _IN_ARRAY and not array and self._options.ind != "page":
            raise _Refusal(NO_ARRAY)
        if index not in self._places(info):
            raise _Refusal(NO_INDEX)
        double = info.type in ("U32", "I32", "Float")
        if double and self._options.pkw_words == 3:
            raise _Refusal(102)
        if ak in _WIDTH:
            self._write(info, number, index, ak, message.value or 0, double=double)
        reply = (4 if ak in _IN_ARRAY else 1) + double
        return {"ak": reply, "value": self._held(number, index)}

    def _write(self, info: ParameterInfo, number: int, index: int, ak: int, value: int, *, double: bool) -> None:
        kept = self._options.eeprom_tasks
        if ak in _HIGH and kept == "none":
            raise _Refusal(NO_TASK)
        if double is not (_WIDTH[ak] == 32):
            raise _Refusal(WRONG_TYPE)
        if info.access == "r":
            raise _Refusal(READ_ONLY)
        if info.access == "rw*" and self.motor.running:
            raise _Refusal(WHILE_RUNNING)
        shown = self._shown(info, value)
        if shown is None or (info.minimum is not None and shown < info.minimum):
            raise _Refusal(LIMIT)
        if info.maximum is not None and shown > info.maximum:
            raise _Refusal(LIMIT)
        self._ram[number, index] = value
        if (ak in _HIGH) is (kept == "11-14"):
            self._eeprom[number, index] = value

    def _shown(self, info: ParameterInfo, raw: int) -> Any:
        if info.type == "Float":
            number = shortest_decimal(raw)
            return None if number is None else number * info.factor
        signed = raw - (2**32 if info.type == "I32" else 2**16) if raw not in RANGES[info.type] else raw
        return signed * info.factor

    def _held(self, number: int, index: int) -> int:
        info = self._infos[number]
        measured = self._measured.get(str(info.extra.get("role", "")))
        if measured is None or number in self._poked:
            return self._ram[number, index]
        return self._raw(info, measured())

    def _raw(self, info: ParameterInfo, value: Any) -> int:
        given = Target(number=0, index=None, parameter_set=1, type=info.type, info=None)
        if info.type == "Float":
            return raw_for(given, shortest_decimal(float_bits(float(value) / float(info.factor)) or 0) or 0)
        return raw_for(given, round(float(value) / float(info.factor)))

    def _places(self, info: ParameterInfo) -> range:
        base = self._options.index_base
        return range(base, base + int(info.extra["elements"])) if "elements" in info.extra else range(1)

    def _place(self, parameter: str) -> tuple[int, int]:
        wanted = target(parameter, self._model, self._options)
        place = wanted.number, wanted.index or 0
        if place not in self._ram:
            raise ParameterAddressError(f"the virtual drive holds no parameter {parameter!r}")
        return place

    def _ram_set(self, role: str, value: int, index: int = 0) -> None:
        place = self._roles.get(role, -1), index
        if place in self._ram:
            self._ram[place] = value


class _Refusal(Exception):  # noqa: N818 - an answer of the drive, not an error of the program
    """The drive refuses with AK 7 and this error number."""

    def __init__(self, code: int) -> None:
        self.code = code
        super().__init__(f"error {code}")
