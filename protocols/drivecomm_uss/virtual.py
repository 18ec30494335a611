"""How a USS drive answers (USS specification A-8, A-9, C-15, C-26 to C-31; MICROMASTER 420 Reference Manual p. 46-49).

What no page says is chosen: the control word acts before nothing but the reply; ON needs an edge; a broadcast is obeyed
with the bits that it lets through.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.errors import ParameterAddressError
from drivecomm.profiles import ProfileMachine
from drivecomm.protocol import Framed, LineSettings, Motor, Refusal, VirtualReply, float_bits
from drivecomm_uss import tasks
from drivecomm_uss.messages import Reply, Request
from drivecomm_uss.parameter_area import PAGE
from drivecomm_uss.parameters import RANGES, Target, number_of, target
from drivecomm_uss.telegrams import UssCodec

if TYPE_CHECKING:
    from drivecomm.protocol import Damaged, Model, ParameterInfo
    from drivecomm_uss.options import UssOptions

SILENT, NO_CONTROL = 70, 7220
"""Faults: telegram off time over, where the model names none (F0070); control lost while running (F07220)."""

_GOES = 0b1010000
"""Bits of the control word without which the reference is 0 (C-28)."""
_WARNING, _AT_SETPOINT = 7, 8
"""Bits of the status word (C-31)."""


class VirtualUssDrive:
    """A drive at one address: parameters, control word with its consequences, motor."""

    def __init__(self, address: int, options: UssOptions, model: Model) -> None:
        self.address = address
        self.codec = UssCodec(options)
        self.settings = LineSettings(baudrate=9600, bytesize=8, parity="E", stopbits=1)
        self.gap_s = 0.050
        self.motor = Motor()
        self._options, self._model = options, model
        self._machine = ProfileMachine(tasks.profile(), self.motor, self._wanted_hz)
        self._reference = 0
        self._fed_at: float | None = None
        self._infos = {int(info.address): info for info in model.parameters.values()}
        self._shows = {address: name for name, address in model.quantities.items()}
        self._eeprom = {
            (number, place): _raw(info, info.start or 0)
            for number, info in self._infos.items()
            for place in self._places(info)
        }
        self._ram = dict(self._eeprom)
        self._poked: set[int] = set()
        full = next((each.address for each in self._infos.values() if each.extra.get("full_scale")), "")
        self._full, self._received = self._found(full), self._found(options.reference_parameter)
        self._off_time = self._found(model.watchdog.time if model.watchdog else "")
        self._show(self._found(model.quantities.get("bus_address", "")), address)

    def hear(self, find: Framed | Damaged, now: float) -> VirtualReply | None:
        """Act on a telegram: silence for what is broken, not for this drive, or for all."""
        message = find.message if isinstance(find, Framed) else None
        if not isinstance(message, Request) or message.special:
            return None
        self.follow(now)
        if message.broadcast and self._options.broadcast and (message.enable is None or message.enable[0] & 1):
            self._obey_all(message, now)
        if message.broadcast or message.address != self.address:
            return None
        reply: dict[str, Any] = {"data": message.data, "mirror": True} if message.mirror else self._answer(message)
        if not message.mirror:
            reply |= self._options.process_words(status_word=self._status_word(), actual=self._actual())
            self._control(message.control_word or 0, message.reference or 0, now)
        data = self.codec.encode(Reply(address=self.address, **reply))
        return VirtualReply(data=data, delay_s=self._options.reply_delay_s)

    def peek(self, parameter: str, now: float) -> int | str:
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
        limit_s = self._set_to(self._off_time)
        if limit_s and self._fed_at is not None and now > self._fed_at + limit_s and not self.motor.fault:
            self.trip(next(iter(self._model.faults), SILENT), self._fed_at + limit_s)
        self._machine.follow(now)

    # The process data

    def _control(self, word: int, reference: int, now: float) -> None:
        """Obey a control word; without bit 10 the process data stay as they were."""
        if tasks.profile().commands(word):
            self._fed_at, self._reference = now, reference
            self._show(self._received, reference & 0xFFFF)
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
        options, share = self._options, self._reference / tasks.profile().full if word & _GOES == _GOES else 0.0
        if options.reverse_bit >= 0 and word >> options.reverse_bit & 1:
            share = -share
        return share * self._full_hz()

    def _full_hz(self) -> float:
        """The frequency of 100 %."""
        return self._set_to(self._full) or float(self._options.hertz or 50)

    def _actual(self) -> int:
        return max(-(2**15), min(2**15 - 1, round(self.motor.output_hz / self._full_hz() * tasks.profile().full)))

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
            return {**place, **self._task(message, message.ak)}
        except Refusal as refusal:
            return {**place, "ak": 7, "error": refusal.code}

    def _task(self, message: Request, ak: int) -> dict[str, Any]:
        place = number, index = (message.pnu or 0) + PAGE * (message.page or 0), message.index or 0
        info = self._infos.get(number)
        if info is None:
            raise Refusal(tasks.NO_NUMBER)
        if ak == 9:
            return {"ak": 6, "value": len(self._places(info))}
        task = tasks.TASKS["request"][ak]
        if not (ak in (1, 6) or task.bits) or (task.stored and self._options.eeprom_tasks == "none"):
            raise Refusal(tasks.NO_TASK)
        if task.array and "elements" not in info.extra and self._options.ind != "page":
            raise Refusal(tasks.NO_ARRAY)
        if index not in self._places(info):
            raise Refusal(tasks.NO_INDEX)
        wanted = _as_target(info)
        if wanted.double and self._options.pkw_words == 3:
            raise Refusal(tasks.NO_ROOM)
        if task.bits:
            self._must_take(info, message.value or 0, task.bits)
            self._ram[place] = message.value or 0
            if self._options.eeprom_tasks == ("11-14" if task.stored else "2-8"):
                self._eeprom[place] = self._ram[place]
        value = self._held(*place)
        reply = (4 if task.array else 1) + wanted.double
        return {"ak": reply, "value": value, "pwe": wanted.words_of(value, self._options)}

    def _must_take(self, info: ParameterInfo, value: int, bits: int) -> None:
        """Raise Refusal for a value that the parameter does not take."""
        number = number_of(value, info.type)
        if _as_target(info).double is not (bits == 32):
            raise Refusal(tasks.WRONG_TYPE)
        if info.access == "r":
            raise Refusal(tasks.READ_ONLY)
        if info.access == "rw*" and self.motor.running:
            raise Refusal(tasks.WHILE_RUNNING)
        if number is None or not info.allows(number * info.factor):
            raise Refusal(tasks.LIMIT)

    def _held(self, number: int, index: int) -> int:
        info = self._infos[number]
        quantity = self._shows.get(info.address, "") if info.access == "r" and number not in self._poked else ""
        shown = self._status_word() if quantity == "status_word" else self.motor.measured(quantity)
        return self._ram[number, index] if shown is None else _raw(info, shown)

    def _places(self, info: ParameterInfo) -> range:
        base = self._options.index_base
        return range(base, base + int(info.extra["elements"])) if "elements" in info.extra else range(1)

    def _found(self, parameter: str) -> tuple[int, int] | None:
        """Return number and index of a parameter, None where the drive holds none."""
        wanted = target(parameter, self._model, self._options) if parameter else None
        place = wanted and (wanted.number, wanted.index or 0)
        return place if place in self._ram else None

    def _place(self, parameter: str) -> tuple[int, int]:
        place = self._found(parameter)
        if place is None:
            raise ParameterAddressError(f"the virtual drive holds no parameter {parameter!r}")
        return place

    def _set_to(self, place: tuple[int, int] | None) -> float:
        """Return what a parameter holds, physically, 0 where there is none."""
        if place is None:
            return 0.0
        info = self._infos[place[0]]
        return float((number_of(self._ram[place], info.type) or 0) * info.factor)

    def _show(self, place: tuple[int, int] | None, value: int) -> None:
        if place is not None:
            self._ram[place] = value


def _as_target(info: ParameterInfo) -> Target:
    return Target(number=int(info.address), index=None, parameter_set=1, type=info.type, info=info)


def _raw(info: ParameterInfo, value: Any) -> int:
    """Return the unsigned number that is nearest to a physical value."""
    number = float(value) / float(info.factor)
    return float_bits(number) or 0 if info.type == "Float" else round(number) % len(RANGES[info.type])
