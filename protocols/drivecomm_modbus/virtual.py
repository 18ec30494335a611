"""How a Modbus drive answers, made from the model of its series: the table [control] read from the drive's side."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.profiles import OrderMachine
from drivecomm.protocol import Command, Damaged, Framed, LineSettings, Motor, VirtualReply
from drivecomm_modbus import functions as fn
from drivecomm_modbus.codec import DriveCodec
from drivecomm_modbus.control import control_of
from drivecomm_modbus.memory import Memory
from drivecomm_modbus.messages import Reply, Request
from drivecomm_modbus.telegrams import BROADCAST

if TYPE_CHECKING:
    from drivecomm.protocol import Model
    from drivecomm_modbus.options import ModbusOptions
    from drivecomm_modbus.parameters import Target

_KINDS = {1: "c", 2: "d", 3: "", 4: "i", 5: "c", 6: "", 0x0F: "c", 0x10: "", 0x64: "", 0x65: "", 0x17: ""}
_UNKNOWN_FUNCTION, _UNKNOWN_ADDRESS, _INVALID, _FAILED = 1, 2, 3, 4


class _Refusal(Exception):  # noqa: N818 - becomes a telegram
    def __init__(self, code: int) -> None:
        self.code = code
        super().__init__(code)


class VirtualModbusDrive:
    """A drive at one address. A command is obeyed when its last step is written and the others came before it."""

    def __init__(self, address: int, options: ModbusOptions, model: Model) -> None:
        self.address = address
        self.codec = DriveCodec()
        self.settings = LineSettings()
        self.gap_s = 0.050
        self.motor = Motor()
        self._model, self._options = model, options
        control = self._control = control_of(model, options)
        self.memory = Memory(model, options, control)
        self._references = [each for each in (control.reference_percent, control.reference_hz) if each]
        self._machine = OrderMachine(control.profile, self.motor, self._reference_hz)
        self._machine.power_up(self.memory.words)
        self._heard_at = 0.0

    def hear(self, find: Framed | Damaged, now: float) -> VirtualReply | None:
        """Act on a telegram: silence for what is broken or not for this drive, an exception for what is refused."""
        self._live(now)
        if isinstance(find, Damaged):
            return self._complain(find)
        message = find.message
        if not isinstance(message, Request) or message.address not in (self.address, BROADCAST):
            return None
        self._heard_at = now
        try:
            reply = self._answer(message, now)
        except _Refusal as refusal:
            reply = Reply(address=self.address, function=message.function, exception=refusal.code)
        return None if message.address == BROADCAST else self._send(reply)

    def peek(self, parameter: str, now: float) -> int | str:
        """Return what a read would get."""
        self._live(now)
        return self.memory.fetch(self.memory.known(parameter))

    def poke(self, parameter: str, raw: int | str) -> None:
        """Set what a parameter holds, as if at the keypad."""
        wanted = self.memory.known(parameter)
        self.memory.put(wanted, raw if wanted.format.type == "string" else int(raw))

    def trip(self, code: int, now: float) -> None:
        """Trip with a fault."""
        self.motor.trip(code, now)

    def power_cycle(self, now: float) -> None:
        """Switch mains off and on: commands, a trip and what was not stored are gone."""
        self.motor.stop(Command.OFF, now)
        self.motor.reset(now)
        self.motor.warning = False
        self.memory.power_cycle()
        self._machine.power_up(self.memory.words)

    def _live(self, now: float) -> None:
        self.motor.advance(now)
        self._watch(now)
        self.memory.show(self.motor)
        self.memory.words.update(self._machine.status_words(self._control.status))

    def _watch(self, now: float) -> None:
        """Do what the watchdog says once the master has been silent for longer than its time."""
        watchdog = self._model.watchdog
        if watchdog is None or not self.motor.running or watchdog.time not in self.memory.targets:
            return
        timer = self.memory.targets[watchdog.time]
        raw = self.memory.fetch(timer)
        if not isinstance(raw, int) or timer.info is None or raw == (watchdog.off or 0):
            return
        if now - self._heard_at <= raw * float(timer.info.factor):
            return
        action = self.memory.fetch(self.memory.targets[watchdog.action]) if watchdog.action else None
        policy = next((each for each, code in watchdog.actions.items() if action in (None, code)), "hold")
        if policy == "trip":
            self.motor.trip(next(iter(self._model.faults), 1), now)
        elif policy != "hold":
            self.motor.stop(Command.OFF if policy == "coast" else Command.RAMP_STOP, now)

    def _complain(self, find: Damaged) -> VirtualReply | None:
        """Answer exception 3 to a sound telegram with a wrong field, silence to all else."""
        data = find.data
        if find.error.category != "field" or data[0] != self.address:
            return None
        return self._send(Reply(address=self.address, function=data[1] & 0x7F, exception=_INVALID))

    def _send(self, reply: Reply) -> VirtualReply:
        return VirtualReply(data=self.codec.encode(reply), delay_s=self._options.reply_delay_s)

    def _answer(self, message: Request, now: float) -> Reply:
        function, start = message.function, message.start or 0
        same: dict[str, Any] = {"address": self.address, "function": function}
        if function == fn.DIAGNOSTICS and message.sub_function == 0:
            return Reply(**same, sub_function=0, value=message.value)
        if function in (fn.IDENTIFICATION, fn.REPORT_ID) and function == self._control.identification:
            return self._identity(same)
        if function not in _KINDS or (function in (fn.READ_LONG, fn.WRITE_LONG) and not self._options.wide_functions):
            raise _Refusal(_UNKNOWN_FUNCTION)
        kind = _KINDS[function]
        if function == fn.READ_LONG:
            return Reply(**same, value=self._fetch(kind, start, 1)[0])
        if function == fn.WRITE_LONG:
            value = message.value or 0
            self._write(kind, start, (value,), now)
            return Reply(**same, start=start, value=value)
        if message.values is not None:
            self._write(kind, start if message.write_start is None else message.write_start, message.values, now)
            if function != fn.READ_WRITE:
                return Reply(**same, start=start, count=len(message.values))
            self._live(now)
        elif message.value is not None:
            self._write(kind, start, (message.value,), now)
            return Reply(**same, start=start, value=message.value)
        values = tuple(each & 0xFFFF for each in self._fetch(kind, start, message.count or 0))
        if kind in ("c", "d"):
            values += (0,) * (-len(values) % 8)
        return Reply(**same, values=values)

    def _identity(self, same: dict[str, Any]) -> Reply:
        if same["function"] == fn.REPORT_ID:
            return Reply(**same, data=f"{self.address:02X} FF")
        texts = ("drivecomm", self._model.title.encode("ascii", "replace").decode(), "1.0")
        return Reply(
            **same, read_code=1, conformity=1, more_follows=0, next_object=0, object_ids=(0, 1, 2), texts=texts
        )

    def _fetch(self, kind: str, start: int, count: int) -> tuple[int, ...]:
        try:
            return tuple(self.memory.words[f"{kind}{place}"] for place in range(start, start + count))
        except KeyError:
            raise _Refusal(_UNKNOWN_ADDRESS) from None

    def _write(self, kind: str, start: int, values: tuple[int, ...], now: float) -> None:
        memory, control = self.memory, self._control
        volatile = control.volatile_offset and f"{kind}{start}" not in memory.words
        start -= control.volatile_offset if volatile else 0
        places = [f"{kind}{start + offset}" for offset in range(len(values))]
        if any(place not in memory.words for place in places):
            raise _Refusal(_UNKNOWN_ADDRESS)
        before = dict(memory.words)
        memory.words.update(zip(places, values, strict=True))
        touched = [each for each in memory.targets.values() if not set(places).isdisjoint(each.spots)]
        if code := next((code for each in touched if (code := self._objection(each))), 0):
            memory.words = before
            raise _Refusal(code)
        only_ram = volatile or any(each.info is not None and each.info.storage == "volatile" for each in touched)
        if self._stores(places, volatile=bool(only_ram)):
            memory.keep(places)
        for reference in {each.address for each in touched}.intersection(self._references):
            self._references.insert(0, self._references.pop(self._references.index(reference)))
            if self.motor.command is Command.RUN:
                self._machine.act(now)
        self._machine.written(places, memory.words, now)

    def _objection(self, touched: Target) -> int:
        """Return the exception with which a write that has just been made is refused, 0 where it is not."""
        info = touched.info
        if info is None:
            return 0
        if info.access == "r":
            return _UNKNOWN_ADDRESS
        if info.access == "rw*" and self.motor.running:
            return _FAILED
        value = touched.reading(self.memory.fetch(touched)).value
        return 0 if isinstance(value, str) or info.allows(value) else _INVALID

    def _stores(self, places: list[str], *, volatile: bool) -> bool:
        """Return whether a write goes to EEPROM, and take all over where this one is the order to."""
        words, storing = self.memory.words, self._control.storing
        if any(step.place in places for step in storing.get("store_after", ())):
            self.memory.keep_all()
        if volatile or "store_before" not in storing:
            return not volatile and self._control.plain_write == "stored"
        return all(words[step.place] & step.mask == step.word & step.mask for step in storing["store_before"])

    def _reference_hz(self) -> float:
        """Return the reference that was written last."""
        if not self._references:
            return 0.0
        wanted = self.memory.targets[self._references[0]]
        value = float(wanted.reading(self.memory.fetch(wanted)).value)
        return value * self.motor.maximum_hz / 100 if wanted.address == self._control.reference_percent else value
