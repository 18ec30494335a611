"""A virtual USS drive (USS specification A-8, A-9, C-15, C-26 to C-31; MICROMASTER 420 Reference Manual p. 46-49).

Some behaviour is on no page and was chosen here: the control word takes effect only after the reply has been made; ON
needs an edge; a broadcast is obeyed with the bits that its enable array passes.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeAlias

from drivecomm.errors import ParameterAddressError, TelegramError
from drivecomm.profiles import ProfileMachine
from drivecomm.protocol import DriveRepr, Framed, LineSettings, Motor, ParameterStore, Refusal, VirtualReply, float_bits
from drivecomm_uss import tasks
from drivecomm_uss.messages import Reply, Request
from drivecomm_uss.options import VARIABLE
from drivecomm_uss.parameter_area import PAGE, values_of
from drivecomm_uss.parameters import DOUBLE, RANGES, number_of, target, words_of
from drivecomm_uss.telegrams import UssCodec

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivecomm.protocol import Damaged, Message, Model, ParameterInfo
    from drivecomm_uss.messages import Words
    from drivecomm_uss.options import UssOptions
    from drivecomm_uss.tasks import UssTask

Place: TypeAlias = tuple[int, int, int]
"""Place of one value: parameter number, parameter set, index."""

SILENT, NO_CONTROL = 70, 7220
"""Fault codes: telegram off time exceeded, if the model gives none (F0070); control lost while running (F07220)."""

_WARNING, _AT_SETPOINT = 7, 8
"""Bits of the status word (C-31)."""


class VirtualUssDrive(DriveRepr):
    """A drive at one address, with parameters, control word and motor."""

    def __init__(self, address: int, options: UssOptions, model: Model) -> None:
        self.address = address
        self.codec = UssCodec(options)
        self.settings = LineSettings(baudrate=9600, bytesize=8, parity="E", stopbits=1)
        self.gap_s = 0.050
        self.motor = Motor()
        self._options, self._model = options, model
        self._any_index = UssCodec(replace(options, ind="word"))
        self._machine = ProfileMachine(tasks.profile(), self.motor, self._wanted_hz)
        self._reference = 0
        self._fed_at: float | None = None
        self._says = tasks.ANSWERS.get(options.ind, tasks.ANSWERS["plain"])
        self._infos = {int(info.address): info for info in model.parameters.values()}
        starts = {
            place: _raw(info, info.start or 0) for number, info in self._infos.items() for place in self._places(number)
        }
        refusals = {"unknown": tasks.NO_NUMBER, "not writable": tasks.READ_ONLY, "limits": tasks.LIMIT}
        self._store: ParameterStore[int, Place, int] = ParameterStore(
            self._infos, starts, {**refusals, "running": self._says["running"]}
        )
        self._measured = {
            place: name
            for name, address in model.quantities.items()
            for place in self._places(int(address))
            if self._infos[place[0]].access == "r"
        }
        full = next((each.address for each in self._infos.values() if each.extra.get("full_scale")), "")
        self._full, self._received = self._found(full), self._found(options.reference_parameter)
        self._off_time = self._found(model.watchdog.time if model.watchdog else "")
        if (shown := self._found(model.quantities.get("bus_address", ""))) is not None:
            self._store.put(shown, address, stored=True)

    def hear(self, find: Framed | Damaged, now: float) -> VirtualReply | None:
        """Act on a telegram: silence for damaged telegrams, for those to other drives, and for broadcasts."""
        message, refused = (find.message, None) if isinstance(find, Framed) else self._strange(find)
        if not isinstance(message, Request) or message.special:
            return None
        self.follow(now)
        if message.broadcast and self._options.obeys_broadcasts and (message.enable is None or message.enable[0] & 1):
            self._obey_all(message, now)
        if message.broadcast or message.address != self.address:
            return None
        if message.mirror:
            return self._send({"data": message.data, "mirror": True}, self.codec)
        return self._send(self._reply(message, refused, now), self.codec if refused is None else self._any_index)

    def refusing(self, find: Framed, code: int, now: float) -> VirtualReply | None:
        """Refuse the task of a telegram with this code; its process data are obeyed."""
        message: Any = find.message
        if not isinstance(message, Request) or message.special or message.broadcast or message.mirror or not message.ak:
            return None
        self.follow(now)
        return self._send(self._reply(message, code, now), self.codec)

    def _reply(self, message: Request, refused: int | None, now: float) -> dict[str, Any]:
        """Act on a telegram for this drive, and return the fields of its reply."""
        reply = self._answer(message, refused)
        reply |= self._options.process_words(status_word=self._status_word(), actual=self._actual())
        self._control(message.control_word or 0, message.reference or 0, now)
        if self._options.ind in ("masterdrives", "plain"):
            # In these families any valid telegram feeds the telegram off time (C-5).
            self._fed_at = now
        return reply

    def _send(self, reply: dict[str, Any], codec: UssCodec) -> VirtualReply:
        data = codec.encode(Reply(address=self.address, **reply))
        return VirtualReply(data=data, delay_s=self._options.reply_delay_s)

    def peek(self, parameter: str, now: float) -> int | str:
        """Return the unsigned number that a read would get."""
        self.follow(now)
        return self._held(self._place(parameter))

    def poke(self, parameter: str, raw: int | str) -> None:
        """Set the value of a parameter; a measured parameter then keeps this value."""
        place, value = self._place(parameter), int(raw)
        if value not in range(2**32 if self._infos[place[0]].type in DOUBLE else 2**16):
            raise ValueError(f"parameter {parameter} has no room for {value}")
        self._measured.pop(place, None)
        self._store.put(place, value)

    def trip(self, code: int, now: float) -> None:
        """Trip with a fault, and stop the telegram off time."""
        self._fed_at = None
        self._machine.trip(code, now)

    def power_cycle(self, now: float) -> None:
        """Switch the mains off and on: RAM values, process data and the fault are lost."""
        self.follow(now)
        self._store.power_cycle()
        self._reference, self._fed_at = 0, None
        self._machine.power_up(now)

    def follow(self, now: float) -> None:
        """Advance the drive's time; trip if the telegram off time has been exceeded, perhaps some time ago."""
        limit_s = self._set_to(self._off_time)
        if limit_s and self._fed_at is not None and now > self._fed_at + limit_s and not self.motor.fault:
            watchdog = self._model.watchdog
            self.trip((watchdog and watchdog.fault) or SILENT, self._fed_at + limit_s)
        self._machine.follow(now)

    # Process data

    def _control(self, word: int, reference: int, now: float) -> None:
        """Obey a control word; without bit 10, the process data keep their earlier values."""
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
        options, profile = self._options, tasks.profile()
        share = profile.directed(word, self._reference / profile.full)
        if options.reverse_bit >= 0 and word >> options.reverse_bit & 1:
            share = -share
        return share * self._full_hz()

    def _full_hz(self) -> float:
        """Return the frequency of 100 %."""
        return self._set_to(self._full) or float(self._options.hertz or 50)

    def _actual(self) -> int:
        return max(-(2**15), min(2**15 - 1, round(self.motor.output_hz / self._full_hz() * tasks.profile().full)))

    def _status_word(self) -> int:
        motor, options = self.motor, self._options
        word = self._machine.status_word() | motor.warning << _WARNING | motor.at_reference << _AT_SETPOINT
        if options.right_bit >= 0:
            # The bits for the direction have the same positions as in the control word (NORD p. 45).
            word |= 1 << (options.reverse_bit if motor.output_hz < 0 else options.right_bit)
        return word

    # Parameters

    def _strange(self, find: Damaged) -> tuple[Message | None, int | None]:
        """Return a sound telegram with an impossible task as one without a task, and the error number for the task.

        Return None twice for other damage.
        """
        data, size = find.data, len(find.data) // 2 - 4 - self._options.pzd_words
        if find.error.category != "field" or data[2] != self.address or not self._options.pkw_words:
            return None, None
        ak = data[3] >> 4
        no_task = data[:3] + bytes([data[3] & 0x0F]) + data[4:-1] + bytes([data[-1] ^ ak << 4])
        try:
            message: Any = self._any_index.decode(no_task, "request")
        except TelegramError:
            return None, None
        if not ak:
            return message, None
        if message.pnu >= PAGE and self._options.ind in ("page", "masterdrives"):
            return message, tasks.NO_NUMBER
        return message, self._says["no_room"] if tasks.TASKS["request"][ak].bits > 16 * size else tasks.NO_INDEX

    def _answer(self, message: Request, refused: int | None) -> dict[str, Any]:
        place = {name: getattr(message, name) for name in ("pnu", "page", "index", "parameter_set")}
        if refused is not None:
            return {**place, "ak": 7, "error": refused}
        if not message.ak:
            return {"ak": 0, "pnu": 0} if self._options.pkw_words else {}
        try:
            return {**place, **self._task(message, message.ak)}
        except Refusal as refusal:
            return {**place, "ak": 7, "error": refusal.code}

    def _task(self, message: Request, ak: int) -> dict[str, Any]:
        number, index = (message.pnu or 0) + PAGE * (message.page or 0), message.index or 0
        task, info, options = tasks.TASKS["request"][ak], self._store.info(number), self._options
        if ak in self._says["unknown_tasks"] or (task.stored and options.eeprom_tasks == "none"):
            raise Refusal(self._says["task"])
        if task.refused:
            raise Refusal(task.refused)
        if ak == 4:
            return {"ak": 3, "pwe": self._description(info, index)}
        if ak == 9:
            return {"ak": 6, "value": int(info.extra.get("elements", 1))}
        # If the tables end with 8, tasks 6 to 8 correspond to 1 to 3 (G110M Function Manual p. 198).
        if task.array and "elements" not in info.extra and options.eeprom_tasks != "none":
            raise Refusal(tasks.NO_ARRAY)
        if not task.array and "elements" in info.extra and options.ind == "masterdrives":
            raise Refusal(tasks.INDEXED)
        whole, double = task.array and index == 255, info.type in DOUBLE
        if (whole and options.pkw_words != VARIABLE) or (double and options.pkw_words == 3):
            raise Refusal(self._says["no_room"])
        chosen = message.parameter_set or 1
        places = [place for place in self._places(number) if place[1] == chosen and (whole or place[2] == index)]
        if not places:
            raise Refusal(tasks.NO_INDEX)
        if task.bits:
            self._write(places, task, message.values if whole else (message.value or 0,))
        values = tuple(self._held(place) for place in places)
        if whole:
            return {"ak": 4 + double, "values": values}
        reply = (4 if task.array else 1) + double
        return {"ak": reply, "value": values[0], "pwe": words_of(values[0], info.type, options)}

    def _write(self, places: Sequence[Place], task: UssTask, values: Words | None) -> None:
        """Set all of these values, or none. Raises Refusal for a value that the parameter does not accept."""
        info = self._infos[places[0][0]]
        if (info.type in DOUBLE) is not (task.bits == 32):
            raise Refusal(tasks.WRONG_TYPE)
        self._store.writable(places[0][0], running=self.motor.running)
        if values is None or len(values) != len(places):
            raise Refusal(tasks.HOW_MANY)
        for value in values:
            number = number_of(value, info.type)
            if number is None:
                raise Refusal(tasks.LIMIT)
            self._store.must_allow(info, number * info.factor)
        kept = self._options.eeprom_tasks == ("11-14" if task.stored else "2-8")
        for place, value in zip(places, values, strict=True):
            self._store.put(place, value, stored=kept)

    def _description(self, info: ParameterInfo, element: int) -> Words:
        """Return a description element: 2 is the number of elements, 7 and 8 are the limits, if known.

        The USS specification uses element 7 (C-39); the VLT 5000 Design Guide MG.52.B2.02, p. 95 to 98, lists the
        elements of a description in the same form.
        """
        limit = {7: info.minimum, 8: info.maximum}.get(element)
        if element != 2 and limit is None:
            raise Refusal(tasks.NO_INDEX)
        double = limit is not None and info.type in DOUBLE
        value = int(info.extra.get("elements", 1)) if limit is None else _raw(info, limit)
        words = divmod(value, 2**16) if double or self._options.pkw_words == 4 else (value,)
        if double and self._options.pkw_words == 3:
            raise Refusal(self._says["no_room"])
        return words

    def _held(self, place: Place) -> int:
        info, name = self._infos[place[0]], self._measured.get(place, "")
        shown = self._status_word() if name == "status_word" else self.motor.measured(name)
        return self._store.held[place] if shown is None else _raw(info, shown)

    def _places(self, number: int) -> list[Place]:
        """Return the places of a parameter: one for each parameter set and each element."""
        base, elements = self._options.index_base, self._infos[number].extra.get("elements")
        indices = range(1) if elements is None else range(base, base + int(elements))
        return [(number, each, index) for each in values_of("parameter_set", self._options.ind) for index in indices]

    def _found(self, parameter: str) -> Place | None:
        """Return the place of a parameter in the first set; None if the drive does not hold it."""
        wanted = target(parameter, self._model, self._options) if parameter else None
        place = wanted and (wanted.number, 1, wanted.index or 0)
        return place if place in self._store.held else None

    def _place(self, parameter: str) -> Place:
        place = self._found(parameter)
        if place is None:
            raise ParameterAddressError(f"the virtual drive holds no parameter {parameter!r}")
        return place

    def _set_to(self, place: Place | None) -> float:
        """Return the physical value of a parameter; 0 if there is none."""
        if place is None:
            return 0.0
        info = self._infos[place[0]]
        return float((number_of(self._store.held[place], info.type) or 0) * info.factor)

    def _show(self, place: Place | None, value: int) -> None:
        if place is not None:
            self._store.put(place, value, stored=False)


def _raw(info: ParameterInfo, value: Any) -> int:
    """Return the unsigned number nearest to a physical value; an unknown type counts as a word."""
    number = float(value) / float(info.factor)
    return float_bits(number) or 0 if info.type == "Float" else round(number) % len(RANGES[info.type or "U16"])
