"""Effects of the operation command of a virtual Fuji inverter on its motor, its measured values, and its alarms.

Sections 6, 8 and 9 of the specification; HVAC/AQUA RS-485 manual 4-17.

Reaction to a silent host: FRENIC-VG option manual 5-11 (H32, H33, H38); FRENIC-MEGA manual 5-274 and FRENIC-Mini manual
9-121 (y02, y03, y08); HVAC/AQUA RS-485 manual 4-17: on the newer series a good frame to any station counts. Section 10
of the specification. Details that no page states are chosen here. On FRENIC-VG only frames to its own station and to
all stations count. The time begins with the first frame received. Silence matters only while the link has the run
command or the frequency, as on G11S (its technical information, 2-57). With action 1 the trip comes even if the host
sends again before the timer expires. y03 counts in tenths of a second if the model gives it no format. FVR-E11S and
G11S have no function for the time.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any

from drivecomm.profiles import drive_motor
from drivecomm.protocol import MotorCommand
from drivecomm_fuji import words
from drivecomm_fuji.generations import TABLES
from drivecomm_fuji.words import COMMAND, FREQUENCY, FREQUENCY_PU, FULL_SCALE

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from drivecomm.protocol import Motor
    from drivecomm_fuji.options import FujiOptions
    from drivecomm_fuji.store import FujiStore

_RAMP_S = 6.0
"""Ramp time in seconds if the model does not give the format of F07 and F08."""

_AT_ALARM: Mapping[str, str] = TABLES["at_alarm"]
"""Functions that keep values at an alarm, by the functions whose values they keep."""

_MEMORY = ("M16", "M17", "M18", "M19")
_UNDERVOLTAGE = 10

_COMMUNICATION_ALARM = 38
"""Alarm Er8, RS-485 communication."""

_TRIP, _RUN_THEN_TRIP, _TRIP_IF_IT_LASTS = 0, 1, 2


class FujiMachine:
    """Motor, M codes and alarm memory, driven by the operation command and references that H30 gives to the link.

    local_hz: the frequency set at the keypad, used if H30 does not give the reference to the link. busy_until: the time
    until which the parameter written by command A is being stored. latest: the last measured values, which an alarm
    keeps.
    """

    def __init__(self, motor: Motor, store: FujiStore, options: FujiOptions) -> None:
        self.local_hz = self.busy_until = 0.0
        self.latest: dict[str, float] = {}
        self.silence = SilenceWatch(store, options.generation.silence)
        self._motor = motor
        self._store = store
        self._profile = options.generation
        self._coast = 1 << self._profile.terminals[options.coast_terminal] if options.coast_terminal else 0
        self._asks = cache(words.control_profile().asks)
        self._alarm = False
        self._command = 0
        self._now = 0.0
        store.measured = self._measured()

    def power_up(self, now: float) -> None:
        """Begin as after a power-up: commands (S codes) and an alarm are lost."""
        self._store.initialise("S")
        self._motor.stop(MotorCommand.OFF, now)
        self._motor.reset(now)
        self._alarm, self._command, self.busy_until = False, 0, 0.0
        self.silence.forget()

    def has_right(self, function: str) -> bool:
        """Return whether H30 gives this function to the link: 1 gives the frequency, 2 the run command, 3 both."""
        right = int(self._store.number("H30", 3.0))
        return bool(right & (2 if function == COMMAND else 1))

    def obey(self, word: int, now: float) -> None:
        """Obey a written S06; RST acknowledges an alarm when it rises."""
        if word & words.RESET and not self._command & words.RESET:
            self.reset(now)
        self._command = word

    def reset(self, now: float) -> None:
        """Acknowledge the alarm. A run command that is still set starts the motor again."""
        self._motor.reset(now)
        self.live(now)

    def trip(self, code: int, now: float) -> None:
        """Trip with this alarm code: output off, memory M16 to M19 shifted, values at the alarm kept."""
        self.live(now)
        self._motor.trip(code, now)
        self._note_alarm()
        self.live(now)

    def live(self, now: float) -> None:
        """Run the motor as commanded, record an alarm, and record the values that an alarm would keep."""
        self._now = now
        # A trip caused by silence may have become due some time ago.
        due = self.silence.trip_due(now)
        if due is not None and not self._motor.fault and self._is_linked():
            self._motor.trip(_COMMUNICATION_ALARM, due)
        self._motor.advance(now)
        if self._motor.fault and not self._alarm:
            self._note_alarm()
        self._alarm = bool(self._motor.fault)
        self._set_ramps()
        word = self._run_command()
        does = "off" if word & self._coast else self._asks(word & words.RUN)
        direction = -1 if word & words.REVERSE else 1
        drive_motor(self._motor, does, lambda: direction * self._reference_hz(), now)
        self.latest = {function: self._store.measured[function]() for function in _AT_ALARM}

    def _is_linked(self) -> bool:
        return self.has_right(COMMAND) or self.has_right(FREQUENCY)

    def _run_command(self) -> int:
        return self._store.word_of(COMMAND) if self.has_right(COMMAND) else 0

    def _reference_hz(self) -> float:
        """Return the frequency to run at, signed like S01: S01 overrides S05, and the maximum frequency limits both."""
        maximum = self._motor.maximum_hz
        if not self.has_right(FREQUENCY):
            return self.local_hz
        word = self._store.word_of(FREQUENCY_PU)
        per_unit = word - 0x10000 if word >= 0x8000 else word
        if per_unit or not self._profile.s05_is_frequency:
            return per_unit / FULL_SCALE * maximum
        return min(self._store.word_of(FREQUENCY) / 100, maximum)

    def _set_ramps(self) -> None:
        motor, number = self._motor, self._store.number
        motor.maximum_hz = number("F03") or motor.maximum_hz
        scale = motor.rated_hz / motor.maximum_hz
        motor.ramp_up_s = (number("S08") or number("F07", _RAMP_S)) * scale
        motor.ramp_down_s = (number("S09") or number("F08", _RAMP_S)) * scale

    def _note_alarm(self) -> None:
        """Add an alarm to the memory, newest first, and keep the last measured values."""
        for newer, older in zip(_MEMORY[-2::-1], _MEMORY[:0:-1], strict=True):
            self._store.keep(newer, None, older)
        self._store.set("M16", self._motor.fault)
        for live, kept in _AT_ALARM.items():
            self._store.keep(live, self.latest.get(live), kept)
        self._alarm = True

    def _measured(self) -> dict[str, Callable[[], float]]:
        """Return the functions that compute the values of measuring M codes when they are read."""
        motor, torque = self._motor, lambda: self._motor.torque_percent
        # An inverter that never sends the sign character shows the magnitude; M14 shows the direction.
        signed = "M09" in self._profile.sign_functions

        def per_hz() -> float:
            return FULL_SCALE / motor.maximum_hz

        return {
            "M01": lambda: (-self._reference_hz() if self._backwards() else self._reference_hz()) * per_hz(),
            **dict.fromkeys(("M02", "M03", "M07", "M08"), torque),
            "M05": lambda: abs(self._reference_hz()),
            "M06": lambda: motor.output_hz * per_hz(),
            "M09": lambda: motor.output_hz if signed else abs(motor.output_hz),
            "M10": lambda: motor.power_kw / motor.rated_kw * 100,
            "M11": lambda: motor.current_a / motor.rated_a * 100,
            "M12": lambda: motor.voltage_v,
            "M13": lambda: self._run_command() & ~words.RESET,
            "M14": self._status,
            "M15": lambda: self._store.word_of("S07"),
            "M20": lambda: motor.running_s // 3600,
            "M21": lambda: motor.dc_link_v,
        }

    def _backwards(self) -> bool:
        return self._run_command() & words.RUN == words.REVERSE

    def _status(self) -> int:
        motor, on = self._motor, self._is_linked()
        reverse = motor.output_hz < 0 if motor.output_hz else self._backwards()
        # Before the motor turns the other way, it slows down.
        turning = motor.output_hz * motor.target_hz < 0
        word = words.control_profile().word_of(
            {
                "FWD": motor.running and not reverse,
                "REV": motor.running and reverse,
                "INT": not motor.running,
                "NUV": motor.fault != _UNDERVOLTAGE,
                "ACC": motor.accelerating and not turning,
                "DEC": motor.decelerating or (motor.running and turning),
                "ALM": bool(motor.fault),
                "RL": on,
                "BUSY": self._now < self.busy_until,
            }
        )
        return word | (1 << 13 if on and self._profile.name == "g11s" else 0)


class SilenceWatch:
    """Detection of a silent host by one inverter, over time.

    functions: `Generation.silence`.
    """

    def __init__(self, store: FujiStore, functions: Mapping[str, Any]) -> None:
        self._store = store
        self._functions = functions
        self._heard_at: float | None = None
        self._trip_at: float | None = None

    def heard(self, now: float) -> None:
        """Record a good frame to this inverter or to all. Call `trip_due` first, or an earlier trip may be lost."""
        self._heard_at = now

    def overheard(self, now: float) -> None:
        """Record a good frame to another station."""
        if self._heard_at is not None and self._functions.get("any_station"):
            self._heard_at = now

    def is_over(self, now: float) -> bool:
        """Return whether the host has been silent for longer than the function allows."""
        if not self._functions or self._heard_at is None:
            return False
        time_s = self._store.number(self._functions["time"])
        return bool(time_s) and now > self._heard_at + time_s

    def forget(self) -> None:
        """Begin as after a power-up."""
        self._heard_at = self._trip_at = None

    def trip_due(self, now: float) -> float | None:
        """Return the time of a trip that is due by now; None otherwise. Each trip is returned once."""
        if self._trip_at is None:
            self._trip_at = self._begun(now)
        if self._trip_at is None or now <= self._trip_at:
            return None
        due, self._trip_at, self._heard_at = self._trip_at, None, None
        return due

    def _begun(self, now: float) -> float | None:
        """Return the time of the trip that the silence has caused; None if it has not caused one yet."""
        if self._heard_at is None or not self.is_over(now):
            return None
        noticed_at = self._heard_at + self._store.number(self._functions["time"])
        action = self._store.word_of(self._functions["action"])
        if action == _TRIP:
            return noticed_at
        timer = self._functions["timer"]
        trip_at = noticed_at + self._store.number(timer, self._store.word_of(timer) / 10)
        if action == _RUN_THEN_TRIP or (action == _TRIP_IF_IT_LASTS and now > trip_at):
            return trip_at
        return None
