"""What the operation command of a virtual Fuji inverter does to its motor, what the inverter measures, its alarms.

Sections 6, 8 and 9 of the specification; HVAC/AQUA RS-485 manual 4-17.

What it does when its host falls silent: FRENIC-VG option manual 5-11 (H32, H33, H38); FRENIC-MEGA manual 5-274 and
FRENIC-Mini manual 9-121 (y02, y03, y08); HVAC/AQUA RS-485 manual 4-17: on the newer series a good frame to any station
counts. Section 10 of the specification. What no page says of that is chosen: on FRENIC-VG only frames to its own
station and to all count. The time begins with the first frame heard, and silence matters only while the link has the
run command or the frequency, as on G11S (its technical information, 2-57). With action 1 the trip comes also when the
host speaks again before the timer is over. y03 counts in tenths of a second where the model gives it no format.
FVR-E11S and G11S have no function for the time.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any

from drivecomm.profiles import have_do
from drivecomm.protocol import Command
from drivecomm_fuji import words
from drivecomm_fuji.generations import TABLES
from drivecomm_fuji.words import COMMAND, FREQUENCY, FREQUENCY_PU, FULL_SCALE

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from drivecomm.protocol import Motor
    from drivecomm_fuji.options import FujiOptions
    from drivecomm_fuji.store import Store

_RAMP_S = 6.0
"""Ramp time where the model does not tell the format of F07 and F08."""

_AT_ALARM: Mapping[str, str] = TABLES["at_alarm"]
"""Which function keeps the value of which at an alarm."""

_MEMORY = ("M16", "M17", "M18", "M19")
_UNDERVOLTAGE = 10

_COMMUNICATION_ALARM = 38
"""Er8, RS-485 communication."""

_TRIP, _RUN_THEN_TRIP, _TRIP_IF_IT_LASTS = 0, 1, 2


class Machine:
    """Operation command and references in, where H30 gives them to the link; motor, M codes and alarm memory out.

    local_hz: the frequency set at the keypad, used when H30 does not give the reference to the link. busy_until: when
    the parameter that command A wrote is stored. latest: what was measured last, which an alarm keeps.
    """

    def __init__(self, motor: Motor, store: Store, options: FujiOptions) -> None:
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
        """Begin anew: what was commanded (S codes) and an alarm are gone."""
        self._store.initialise("S")
        self._motor.stop(Command.OFF, now)
        self._motor.reset(now)
        self._alarm, self._command, self.busy_until = False, 0, 0.0
        self.silence.forget()

    def has_right(self, function: str) -> bool:
        """H30: 1 gives the frequency to the link, 2 the run command, 3 both."""
        right = int(self._store.number("H30", 3.0))
        return bool(right & (2 if function == COMMAND else 1))

    def obey(self, word: int, now: float) -> None:
        """Take S06 as it was written; RST acknowledges an alarm when it rises."""
        if word & words.RESET and not self._command & words.RESET:
            self.reset(now)
        self._command = word

    def reset(self, now: float) -> None:
        """Acknowledge the alarm. A run command that is still there starts the motor again."""
        self._motor.reset(now)
        self.live(now)

    def trip(self, code: int, now: float) -> None:
        """Trip with this alarm code: output off, memory M16 to M19 moved on, values at the alarm kept."""
        self.live(now)
        self._motor.trip(code, now)
        self._note_alarm()
        self.live(now)

    def live(self, now: float) -> None:
        """Let the motor turn as commanded, note an alarm, and note what an alarm would keep."""
        self._now = now
        # Silence may have asked for a trip some time ago.
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
        have_do(self._motor, does, lambda: direction * self._reference_hz(), now)
        self.latest = {function: self._store.measured[function]() for function in _AT_ALARM}

    def _is_linked(self) -> bool:
        return self.has_right(COMMAND) or self.has_right(FREQUENCY)

    def _run_command(self) -> int:
        return self._store.word_of(COMMAND) if self.has_right(COMMAND) else 0

    def _reference_hz(self) -> float:
        """The frequency to run at, signed as S01: S01 beats S05, and the maximum frequency limits both."""
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
        """Enter an alarm into the memory, newest first, and keep what was measured last."""
        for newer, older in zip(_MEMORY[-2::-1], _MEMORY[:0:-1], strict=True):
            self._store.keep(newer, None, older)
        self._store.set("M16", self._motor.fault)
        for live, kept in _AT_ALARM.items():
            self._store.keep(live, self.latest.get(live), kept)
        self._alarm = True

    def _measured(self) -> dict[str, Callable[[], float]]:
        """Return what each M code that shows a measured value gets it from when it is read."""
        motor, torque = self._motor, lambda: self._motor.torque_percent
        # An inverter that never sends the sign character shows the magnitude; M14 tells the direction.
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
        # On the way to the other direction the motor slows down first.
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
    """The silence detection of one inverter, over time. functions: `Profile.silence`."""

    def __init__(self, store: Store, functions: Mapping[str, Any]) -> None:
        self._store = store
        self._functions = functions
        self._heard_at: float | None = None
        self._trip_at: float | None = None

    def heard(self, now: float) -> None:
        """Take note of a good frame to this inverter or to all; what was due before has been asked for before."""
        self._heard_at = now

    def overheard(self, now: float) -> None:
        """Take note of a good frame to another station."""
        if self._heard_at is not None and self._functions.get("any_station"):
            self._heard_at = now

    def is_over(self, now: float) -> bool:
        """Whether nobody has been heard for longer than the function says."""
        if not self._functions or self._heard_at is None:
            return False
        time_s = self._store.number(self._functions["time"])
        return bool(time_s) and now > self._heard_at + time_s

    def forget(self) -> None:
        """Begin as after mains is switched on."""
        self._heard_at = self._trip_at = None

    def trip_due(self, now: float) -> float | None:
        """Return when the inverter trips, if it does so by now; None otherwise. A trip is told once."""
        if self._trip_at is None:
            self._trip_at = self._begun(now)
        if self._trip_at is None or now <= self._trip_at:
            return None
        due, self._trip_at, self._heard_at = self._trip_at, None, None
        return due

    def _begun(self, now: float) -> float | None:
        """Return when a trip that the silence has decided comes, None where it has decided none yet."""
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
