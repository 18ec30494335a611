"""How a USS drive answers (USS specification A-8, A-9, C-15, C-26 to C-31; MICROMASTER 420 Reference Manual p. 46-49).

What no page says is chosen: the control word acts before nothing but the reply; ON needs an edge; a broadcast is obeyed
with the bits that it lets through.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.errors import ParameterAddressError
from drivecomm.profiles import ProfileMachine
from drivecomm.protocol import Framed, LineSettings, Motor, Refusal, VirtualReply
from drivecomm_uss.memory import profile
from drivecomm_uss.messages import Reply, Request
from drivecomm_uss.parameters import PAGE, RANGES, Target, float_bits, number_of, target
from drivecomm_uss.tasks import TASKS
from drivecomm_uss.telegrams import UssCodec

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.protocol import Damaged, Model, ParameterInfo
    from drivecomm_uss.options import UssOptions
    from drivecomm_uss.tasks import Task

NO_NUMBER, READ_ONLY, LIMIT, NO_INDEX, NO_ARRAY, WRONG_TYPE, WHILE_RUNNING, NO_TASK = 0, 1, 2, 3, 4, 5, 17, 106
NO_ROOM = 102
SILENT, NO_CONTROL = 70, 7220
"""Faults: telegram off time over (F0070), control by the master lost while running (F07220)."""

_GOES = 0b1010000
"""Bits of the control word without which the reference is 0 (C-28)."""
_WARNING, _AT_SETPOINT = 7, 8
"""Bits of the status word (C-31)."""


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
        self._machine = ProfileMachine(profile(), self.motor, self._wanted_hz)
        self._reference = 0
        self._fed_at: float | None = None
        self._infos = {int(info.address): info for info in model.parameters.values()}
        self._roles = {str(info.extra["role"]): number for number, info in self._infos.items() if "role" in info.extra}
        self._eeprom = {
            (number, place): _raw(info, info.start or 0)
            for number, info in self._infos.items()
            for place in self._places(info)
        }
        self._ram = dict(self._eeprom)
        self._poked: set[int] = set()
        motor = self.motor
        self._measured: dict[str, Callable[[], float]] = {
            "output_hz": lambda: abs(motor.output_hz),
            "current": lambda: motor.current_a,
            "voltage": lambda: motor.voltage_v,
            "dc_link": lambda: motor.dc_link_v,
            "status_word": self._status_word,
            "fault": lambda: motor.fault,
        }
        self._ram_set("address", address)

    def hear(self, find: Framed | Damaged, now: float) -> VirtualReply | None:
        """Act on a telegram: silence for what is broken, not for this drive, or for all."""
        message = find.message if isinstance(find, Framed) else None
        if not isinstance(message, Request) or message.special:
            return None
        self.follow(now)
        if message.broadcast and self._options.broadcast:
            self._obey_all(message, now)
        if message.broadcast or message.address != self.address:
            return None
        reply: dict[str, Any] = {"data": message.data, "mirror": True} if message.mirror else self._answer(message)
        if not message.mirror:
            reply |= self._options.process_words(status_word=self._status_word(), actual=self._actual())
            self._control(message.control_word or 0, message.reference or 0, now)
        data = self.codec.encode(Reply(address=self.address, **reply))
        return VirtualReply(data=data, delay_s=self._options.reply_delay_s)

    def peek(self, parameter: str, now: float) -> int:
        """Return the unsigned number that a read would get."""
        self.follow(now)
        return self._held(*self._place(parameter))

    def poke(self, parameter: str, raw: int | str) -> None:
        """Set what a parameter holds; one that the drive measures is not measured any more."""
        place, value = self._place(parameter), int(raw)
        if value not in range(2**32 if _as_target(self._infos[place[0]]).double else 2**16):
            raise ValueError(f"parameter {parameter} has no room for {value}")
        self._poked.add(place[0])
        self._ram[place] = self._eeprom[place] = value

    def trip(self, code: int, now: float) -> None:
        """Trip with a fault; the time may be over."""
        self._fed_at = None
        self._machine.trip(code, now)

    def power_cycle(self, now: float) -> None:
        """Switch mains off and on: RAM values, process data and the fault are gone."""
        self.follow(now)
        self._ram = dict(self._eeprom)
        self._reference, self._fed_at = 0, None
        self._machine.power_up(now)

    def follow(self, now: float) -> None:
        """Let time pass, and trip when the telegram off time was over, which may be some time ago."""
        limit_s = self._set_to("off_time")
        if limit_s and self._fed_at is not None and now > self._fed_at + limit_s and not self.motor.fault:
            self.trip(SILENT, self._fed_at + limit_s)
        self._machine.follow(now)

    # The process data

    def _control(self, word: int, reference: int, now: float) -> None:
        """Obey a control word; without bit 10 the process data stay as they were."""
        if profile().commands(word):
            self._fed_at, self._reference = now, reference
            self._ram_set("reference", reference & 0xFFFF, 1)
            self._machine.control(word, now)
        elif self._options.running_needs_control and self.motor.running and self._machine.word:
            self.trip(NO_CONTROL, now)

    def _obey_all(self, message: Request, now: float) -> None:
        enable, word, reference = message.enable, message.control_word or 0, message.reference or 0
        own = self._machine.word
        if enable is not None:
            word = own & ~enable[1] | word & enable[1] if enable[0] & 2 else own
            reference = reference if enable[0] & 4 else self._reference
        if own or enable is None:
            self._control(word, reference, now)

    def _wanted_hz(self, word: int) -> float:
        share = self._reference / profile().full if word & _GOES == _GOES else 0.0
        return share * self._full_hz() * self._direction(word)

    def _direction(self, word: int) -> int:
        options = self._options
        if options.reverse_bit >= 0 and word >> options.reverse_bit & 1:
            return -1
        return 1 if options.right_bit < 0 or word >> options.right_bit & 1 else 0

    def _full_hz(self) -> float:
        """The frequency of 100 %."""
        return self._set_to("full_hz") or float(self._options.hertz or 50)

    def _actual(self) -> int:
        return max(-(2**15), min(2**15 - 1, round(self.motor.output_hz / self._full_hz() * profile().full)))

    def _status_word(self) -> int:
        motor, options = self.motor, self._options
        word = self._machine.status_word() | motor.warning << _WARNING | motor.at_reference << _AT_SETPOINT
        if options.right_bit >= 0:
            # The bits for the direction stand at the same place as in the control word (NORD p. 45).
            word |= 1 << (options.reverse_bit if motor.output_hz < 0 else options.right_bit)
        return word

    # Parameters

    def _answer(self, message: Request) -> dict[str, Any]:
        if not message.ak:
            return {"ak": 0, "pnu": 0} if self._options.pkw_words else {}
        place = {name: getattr(message, name) for name in ("pnu", "page", "index", "parameter_set")}
        try:
            return {**place, **self._task(message)}
        except Refusal as refusal:
            return {**place, "ak": 7, "error": refusal.code}

    def _task(self, message: Request) -> dict[str, Any]:
        ak, index = message.ak or 0, message.index or 0
        number = (message.pnu or 0) + PAGE * (message.page or 0)
        info = self._infos.get(number)
        if info is None:
            raise Refusal(NO_NUMBER)
        if ak == 9:
            return {"ak": 6, "value": len(self._places(info))}
        task = TASKS["request"][ak]
        if not (ak in (1, 6) or task.bits) or (task.stored and self._options.eeprom_tasks == "none"):
            raise Refusal(NO_TASK)
        if task.array and "elements" not in info.extra and self._options.ind != "page":
            raise Refusal(NO_ARRAY)
        if index not in self._places(info):
            raise Refusal(NO_INDEX)
        wanted = _as_target(info)
        if wanted.double and self._options.pkw_words == 3:
            raise Refusal(NO_ROOM)
        if task.bits:
            self._write(info, (number, index), task, message.value or 0)
        value = self._held(number, index)
        reply = (4 if task.array else 1) + wanted.double
        return {"ak": reply, "value": value, "pwe": wanted.words_of(value, self._options)}

    def _write(self, info: ParameterInfo, place: tuple[int, int], task: Task, value: int) -> None:
        if _as_target(info).double is not (task.bits == 32):
            raise Refusal(WRONG_TYPE)
        if info.access == "r":
            raise Refusal(READ_ONLY)
        if info.access == "rw*" and self.motor.running:
            raise Refusal(WHILE_RUNNING)
        number = number_of(value, info.type)
        if number is None or not info.allows(number * info.factor):
            raise Refusal(LIMIT)
        self._ram[place] = value
        if self._options.eeprom_tasks == ("11-14" if task.stored else "2-8"):
            self._eeprom[place] = value

    def _held(self, number: int, index: int) -> int:
        info = self._infos[number]
        measure = self._measured.get(str(info.extra.get("role", "")))
        return self._ram[number, index] if measure is None or number in self._poked else _raw(info, measure())

    def _places(self, info: ParameterInfo) -> range:
        base = self._options.index_base
        return range(base, base + int(info.extra["elements"])) if "elements" in info.extra else range(1)

    def _place(self, parameter: str) -> tuple[int, int]:
        wanted = target(parameter, self._model, self._options)
        place = wanted.number, wanted.index or 0
        if place not in self._ram:
            raise ParameterAddressError(f"the virtual drive holds no parameter {parameter!r}")
        return place

    def _set_to(self, role: str) -> float:
        """Return what the parameter with this role holds, physically, 0 where there is none."""
        info = self._infos.get(self._roles.get(role, -1))
        if info is None:
            return 0.0
        number = number_of(self._ram[int(info.address), self._places(info)[0]], info.type)
        return float((number or 0) * info.factor)

    def _ram_set(self, role: str, value: int, index: int = 0) -> None:
        place = self._roles.get(role, -1), index
        if place in self._ram:
            self._ram[place] = value


def _as_target(info: ParameterInfo) -> Target:
    return Target(number=int(info.address), index=None, parameter_set=1, type=info.type, info=info)


def _raw(info: ParameterInfo, value: Any) -> int:
    """Return the unsigned number that is nearest to a physical value."""
    number = float(value) / float(info.factor)
    return float_bits(number) or 0 if info.type == "Float" else round(number) % len(RANGES[info.type])
