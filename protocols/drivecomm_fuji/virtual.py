"""How a Fuji inverter answers.

FVR-E11S manual 9-16 to 9-20; FRENIC5000G11S RS-485 manual p. 13; FRENIC-VG option manual 5-13 to 5-39; HVAC/AQUA RS-485
manual 4-4 to 4-17; sections 2, 5, 8 and 9 of the specification. What it does when its host falls silent stands in
`drivecomm_fuji.silence`.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

from drivecomm.profiles import have_do
from drivecomm.protocol import Command, Damaged, Framed, LineSettings, Motor, Refusal, VirtualReply, looked_into
from drivecomm_fuji import words
from drivecomm_fuji.generations import COMMAND_ERROR, DATA_ERROR, FUNCTION_ERROR, LINK_PRIORITY, WRITE_BUSY, slow_write
from drivecomm_fuji.hearing import Ear, complaint
from drivecomm_fuji.measured import AT_ALARM, measured, shift_alarms
from drivecomm_fuji.parameters import target
from drivecomm_fuji.silence import COMMUNICATION_ALARM, SilenceWatch
from drivecomm_fuji.store import Store
from drivecomm_fuji.telegrams import BROADCAST, Poll, Select, Standard
from drivecomm_fuji.words import COMMAND, FREQUENCY, FREQUENCY_PU, FULL_SCALE

if TYPE_CHECKING:
    from drivecomm.protocol import Model
    from drivecomm_fuji.options import FujiOptions

_BY_ROUTE = frozenset(["S01", "S05", "S06", "S13"])
"""Writing these needs the right that H30 gives (HVAC/AQUA manual 4-17)."""

_BUSY_S = 0.1
"""How long a parameter written by command A is being stored."""

_RAMP_S = 6.0
"""Ramp time where the model does not tell the format of F07 and F08."""


class VirtualFujiDrive:
    """An inverter at one station: functions, M26, operation command with its route, alarm memory, motor.

    local_hz: the frequency set at its keypad, used when H30 does not give the reference to the link.
    """

    def __init__(self, address: int, options: FujiOptions, model: Model) -> None:
        self.address = address
        self.settings = LineSettings()
        self.gap_s = 0.050
        self.motor = Motor()
        self.local_hz = 0.0
        self._profile = options.generation
        self.codec = Ear(self._profile)
        self.store = Store(model, options)
        self.store.measured = measured(
            self.store,
            self.motor,
            self._profile,
            reference_hz=self._reference_hz,
            command=lambda: self._run_command() & ~words.RESET,
            linked=lambda: self._has_right(COMMAND) or self._has_right(FREQUENCY),
            busy=lambda: self._now < self._busy_until,
        )
        self._asks = cache(words.control_profile().asks)
        self._options = options
        self._model = model
        self._silence = SilenceWatch(self.store, self._profile.silence)
        self._alarm = False
        self._command = 0
        self._busy_until = 0.0
        self._now = 0.0
        self._latest: dict[str, float] = {}

    def hear(self, find: Framed | Damaged, now: float) -> VirtualReply | None:
        """Act on a request: silence for a wrong sum and at station 99, a NAK for what is refused."""
        if isinstance(find, Damaged):
            said = complaint(find, self.address)
            if said is None:
                return None
            self._live(now)
            code, nak = said
            self._remember_error(code)
            return None if nak is None else self._reply(nak, 0.0)
        self._live(now)
        message = find.message
        if not isinstance(message, Standard | Select | Poll):
            return None
        if message.address not in (self.address, BROADCAST):
            self._silence.overheard(now)
            return None
        self._silence.heard(now)
        if message.address == BROADCAST and not self._heeds(message):
            return None
        try:
            answer, needs_s = self._obey(message, now)
        except Refusal as refusal:
            self._remember_error(refusal.code)
            answer, needs_s = self._nak(message, refusal.code), 0.0
        return None if message.address == BROADCAST else self._reply(answer, needs_s)

    def peek(self, parameter: str, now: float) -> int:
        """Return what the inverter holds, as `Reading.raw` would show it."""
        self._live(now)
        with looked_into(parameter):
            return self.store.word(target(parameter, self._model, self._options).function)

    def poke(self, parameter: str, raw: int | str) -> None:
        """Set what the inverter holds; what it measures is soon overwritten."""
        function = target(parameter, self._model, self._options).function
        number = int(raw)
        with looked_into(parameter):
            self.store.poke(function, number if function in self._profile.sign_functions else number % 0x10000)
        # An alarm before anything else is heard keeps what was set here.
        self._latest.pop(function, None)

    def power_cycle(self, now: float) -> None:
        """Switch mains off and on: what was commanded (S codes) and an alarm are gone, its memory stays."""
        self._live(now)
        self.store.initialise("S")
        self.motor.stop(Command.OFF, now)
        self.motor.reset(now)
        self._alarm, self._command, self._busy_until = False, 0, 0.0
        self._silence.forget()

    def overhear(self, now: float) -> None:
        """Take note of a sound telegram to another station."""
        if self._silence.is_over(now):
            self._live(now)
        self._silence.overheard(now)

    def follow(self, now: float) -> None:
        """Let time pass."""
        self._live(now)

    def trip(self, code: int, now: float) -> None:
        """Trip with this alarm code: output off, memory M16 to M19 moved on, values at the alarm kept."""
        self._live(now)
        self.motor.trip(code, now)
        self._note_alarm()
        self._live(now)

    # Requests

    def _heeds(self, message: Standard | Select | Poll) -> bool:
        """Whether something at station 99 is executed: W of some S codes, E, a-f and m."""
        if isinstance(message, Standard):
            writes = message.command == "W" and self._profile.takes_from_all(message.function or "")
            return writes or message.command == "E"
        return isinstance(message, Select)

    def _obey(self, message: Standard | Select | Poll, now: float) -> tuple[Standard | Select | Poll, float]:
        """Return the ACK and what it takes beyond the usual time. Raises Refusal."""
        address, command = self.address, message.command
        if command not in self._profile.all_commands:
            raise Refusal(COMMAND_ERROR)
        if isinstance(message, Poll):
            word = self.store.fetch(self._profile.poll[command])
            data = word % 0x10000 if self._options.signed_j else abs(word)
            return Poll(kind="ack", address=address, command=command, data=data), 0.0
        if isinstance(message, Select):
            self._select(message, now)
            return Select(kind="ack", address=address, command=command), 0.0
        if command == "E":
            self._reset(now)
            return Standard(kind="ack", address=address, command="E"), 0.0
        function = message.function or ""
        if self._profile.refusal_of(function, number_check=True):
            raise Refusal(FUNCTION_ERROR)
        if command == "R":
            word = self.store.fetch(function)
            return Standard(
                kind="ack", address=address, command="R", function=function, data=abs(word), negative=word < 0
            ), 0.0
        data = message.data or 0
        # FRENIC-VG takes A for W (option manual 5-20).
        fast = command == "A" and WRITE_BUSY in self._profile.error_codes
        self._write(function, data, now)
        slow = slow_write(function, data)
        if fast and slow:
            self._busy_until = now + _BUSY_S
            slow = None
        echo = data if self._profile.echoes_writes else 0
        answer = Standard(kind="ack", address=address, command=command, function=function, data=echo)
        return answer, slow.needs_s if slow else 0.0

    def _select(self, message: Select, now: float) -> None:
        data = message.data or 0
        if message.command != "m":
            self._write(self._profile.select[message.command], data, now)
        elif data:
            raise Refusal(DATA_ERROR)
        else:
            self._reset(now)

    def _write(self, function: str, data: int, now: float) -> None:
        if function in _BY_ROUTE and self._profile.checks_route and not self._has_right(function):
            raise Refusal(LINK_PRIORITY)
        self.store.check(function, data, running=self.motor.running)
        if function == COMMAND and data & ~self._profile.command_mask:
            raise Refusal(DATA_ERROR)
        if function[0] != "S" and now < self._busy_until:
            raise Refusal(WRITE_BUSY)
        self.store.poke(function, data)
        if function == COMMAND and data & words.RESET and not self._command & words.RESET:
            self._reset(now)
        if function == COMMAND:
            self._command = data
        if function == "H03":
            self._initialise(data)
        if function in ("P04", "A13"):
            # Tuning is over when it is acknowledged.
            self.store.poke(function, 0)
        self._live(now)

    def _initialise(self, data: int) -> None:
        if data:
            everything = self._profile.types.replace("S", "").replace("M", "")
            self.store.initialise("P" if data == 2 else everything)

    def _has_right(self, function: str) -> bool:
        """H30: 1 gives the frequency to the link, 2 the run command, 3 both."""
        right = int(self.store.number("H30", 3.0))
        return bool(right & (2 if function == COMMAND else 1))

    def _nak(self, message: Standard | Select | Poll, code: int) -> Standard | Select | Poll:
        if isinstance(message, Standard):
            function = message.function or "   "
            return Standard(
                kind="nak", address=self.address, command=message.command, function=function, error_code=code
            )
        return type(message)(kind="nak", address=self.address, command=message.command)

    def _reply(self, message: Standard | Select | Poll, needs_s: float) -> VirtualReply:
        delay = self._options.response_interval_s + self._profile.processing_ms / 1000 + needs_s
        return VirtualReply(data=self.codec.encode(message), delay_s=delay)

    def _remember_error(self, code: int) -> None:
        self.store.set(words.ERROR, code)

    # What turns

    def _live(self, now: float) -> None:
        """Let the motor turn as commanded, note an alarm, and note what an alarm would keep."""
        self._now = now
        self._watch(now)
        self.motor.advance(now)
        if self.motor.fault and not self._alarm:
            self._note_alarm()
        self._alarm = bool(self.motor.fault)
        self._set_ramps()
        self._turn(now)
        self._latest = {function: self.store.measured[function]() for function in AT_ALARM}

    def _watch(self, now: float) -> None:
        """Trip when silence asked for it, which may be some time ago."""
        due = self._silence.trip_due(now)
        if due is not None and not self.motor.fault and (self._has_right(COMMAND) or self._has_right(FREQUENCY)):
            self.motor.trip(COMMUNICATION_ALARM, due)

    def _turn(self, now: float) -> None:
        word = self._run_command()
        coast = self._options.coast_terminal
        does = "off" if coast and word >> self._profile.terminals[coast] & 1 else self._asks(word & words.RUN)
        direction = -1 if word & words.REVERSE else 1
        have_do(self.motor, does, lambda: direction * self._reference_hz(), now)

    def _run_command(self) -> int:
        return self.store.word_of(COMMAND) if self._has_right(COMMAND) else 0

    def _reference_hz(self) -> float:
        """The frequency to run at, signed as S01: S01 beats S05, and the maximum frequency limits both."""
        maximum = self.motor.maximum_hz
        if not self._has_right(FREQUENCY):
            return self.local_hz
        word = self.store.word_of(FREQUENCY_PU)
        per_unit = word - 0x10000 if word >= 0x8000 else word
        if per_unit or not self._profile.s05_is_frequency:
            return per_unit / FULL_SCALE * maximum
        return min(self.store.word_of(FREQUENCY) / 100, maximum)

    def _set_ramps(self) -> None:
        motor = self.motor
        motor.maximum_hz = self.store.number("F03") or motor.maximum_hz
        scale = motor.rated_hz / motor.maximum_hz
        motor.ramp_up_s = (self.store.number("S08") or self.store.number("F07", _RAMP_S)) * scale
        motor.ramp_down_s = (self.store.number("S09") or self.store.number("F08", _RAMP_S)) * scale

    def _reset(self, now: float) -> None:
        """Acknowledge the alarm. A run command that is still there starts the motor again."""
        self.motor.reset(now)
        self._live(now)

    def _note_alarm(self) -> None:
        shift_alarms(self.store, self.motor.fault, self._latest)
        self._alarm = True
