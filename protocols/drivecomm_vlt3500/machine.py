"""Effects of the control word on the motor of a virtual VLT, and its status word.

VLT 3000 manual MG.30.A7.02, pages 75 and 78; VLT Series 3500 manual, printed pages 87 and 91. The steps of slow down
and catch up are assumed, and so is the order coast, quick stop, ramp stop, hold if several are requested in one word.
Running (bit 11) lasts until a ramp has brought the motor to a standstill.
"""

from __future__ import annotations

from functools import cache, partial
from typing import TYPE_CHECKING

from drivecomm import profiles
from drivecomm.protocol import MotorCommand, tables_beside
from drivecomm_vlt3500 import words
from drivecomm_vlt3500.words import profile

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.protocol import Motor
    from drivecomm_vlt3500.store import VltStore

_INHIBIT = 11
_STEP_PERCENT = 1.0
_ALL_OFF = words.ON1 | words.ON2 | words.ON3
_LOCAL = (1.0, 2.0)
_LOWEST_V, _HIGHEST_V = 340.0, 480.0
_HOT_C = 100.0
_RATED_HZ = {0.0: 50.0, 1.0: 60.0, 2.0: 87.0, 3.0: 100.0}
"""Rated frequency for the options of 105 on a VLT 2000 (public program); any other value is taken as hertz."""


class VltMachine:
    """Control word in, motor and status word out.

    word: the last valid control word; before any, every OFF is active. overloaded: stopped by overload until it is
    False again (status bit 12). inhibited: start not possible (status bit 6), only with option 11 in parameter 309.
    """

    def __init__(self, motor: Motor, store: VltStore, *, dc_brake: bool) -> None:
        self._motor = motor
        self._store = store
        self._dc_brake = dc_brake
        self._asks = cache(profile().asks)
        self.power_up(0.0)

    def power_up(self, now: float) -> None:
        """Reset the machine: no control word, no trip, set-up 1."""
        self._motor.stop(MotorCommand.OFF, now)
        self._motor.reset(now)
        self.word, self.overloaded, self.setup = 0, False, 1
        self._offset, self._alarm = 0.0, 0
        self.inhibited = self._has_inhibit()

    def obey(self, word: int, mask: int | None, now: float) -> None:
        """Process a control word, unless bit 10 is held or 0. Held groups keep their last valid value."""
        given = 0xFFFF if mask is None else mask
        if not word & given & words.VALID:
            return
        before, self.word = self.word, self.word & ~given | word & given
        rising = self.word & ~before
        if rising & words.RESET and self._motor.fault:
            self._motor.reset(now)
            self._alarm = 0
            self.inhibited = self._has_inhibit()
        if self._has_inhibit() and self.word & (words.ON2 | words.ON3) != words.ON2 | words.ON3:
            self.inhibited = True
        elif self.word & _ALL_OFF == words.ON2 | words.ON3:
            self.inhibited = False
        if rising & words.SLOW_DOWN:
            self._offset -= _STEP_PERCENT
        elif rising & words.CATCH_UP and not self.word & words.SLOW_DOWN:
            self._offset += _STEP_PERCENT
        self.setup = 1 + (self.word & (words.SETUP_LOW | words.SETUP_HIGH)) // words.SETUP_LOW
        self._drive(now)

    def trip(self, code: int, now: float) -> None:
        """Switch the output off until a reset."""
        self._motor.trip(code, now)
        self._alarm = code

    def live(self, now: float) -> None:
        """Advance the time, and apply changed parameters."""
        self._motor.advance(now)
        if self.inhibited and not self._has_inhibit():
            self.inhibited = False
        if self._motor.fault and not self._alarm:
            self._alarm = self._motor.fault
        self._drive(now)

    def status(self) -> int:
        """Return the status word."""
        motor, number, tripped = self._motor, self._store.number, bool(self._motor.fault)
        ready = self.word & _ALL_OFF == _ALL_OFF and not tripped
        in_range = not motor.running or number(210) <= abs(motor.output_hz) <= number(211, 1000.0)
        over_current = motor.current_a > number(209, 1000.0)
        bad_voltage = not _LOWEST_V <= motor.dc_link_v / 2**0.5 <= _HIGHEST_V
        hot = motor.temperature_c > _HOT_C
        return profile().word_of(
            {
                "control ready": ready,
                "drive ready": ready,
                "enabled": ready and bool(self.word & words.NO_COAST),
                "tripped": tripped,
                "OFF2": not self.word & words.ON2,
                "OFF3": not self.word & words.ON3,
                "start not possible": self.inhibited,
                "warning": motor.warning or not in_range or over_current or bad_voltage or hot,
                "speed equals the reference": motor.at_reference,
                "bus control": not self._is_local(),
                "frequency in range": in_range,
                "running": motor.running,
                "stopped by overload": self.overloaded,
                "voltage outside its limits": bad_voltage,
                "current limit exceeded": over_current,
                "thermal timer above 100 %": hot,
            }
        )

    def measured(self) -> dict[tuple[int, ...], Callable[[], float]]:
        """Return the source of each actual value of 502, called when it is read; numbered as on a VLT 2000."""
        of_motor = tables_beside(__file__, "tables.toml")["measured"]
        return {
            **{(int(index),): partial(getattr, self._motor, name) for index, name in of_motor.items()},
            (0,): lambda: self._store.number(516),
            (15,): lambda: 1 if profile().says("warning", {profiles.SOLE_PLACE: self.status()}) else 0,
            (16,): lambda: self.word,
            (17,): self.status,
            (18,): lambda: self._alarm,
        }

    def _drive(self, now: float) -> None:
        motor, store = self._motor, self._store
        motor.maximum_hz = store.number(202, 50.0)
        rated = store.number(105, 50.0)
        motor.rated_hz = _RATED_HZ.get(rated, rated)
        motor.ramp_up_s, motor.ramp_down_s = store.number(215, 5.0), store.number(216, 5.0)
        motor.quick_ramp_s = store.number(218, 1.0)
        jog = self._jog_hz()
        does = self._asks(self.word | words.START if jog else self.word)
        if motor.fault or self.overloaded:
            does = "off"
        elif does == "dc_brake" and not (self._dc_brake or store.number(514) == 1):
            does = "quick"
        elif does in ("run", "hold") and (self._is_local() or self.inhibited):
            does = "ramp"
        if does == "ramp":
            self._offset = 0.0
        direction = -1 if self.word & words.REVERSE else 1
        profiles.drive_motor(motor, does, lambda: direction * (jog or self._reference_hz()), now)

    def _jog_hz(self) -> float:
        """Return the frequency of an active jog bit, else 0; the parameter of jog 2 is probably 512."""
        if self.word & words.JOG_1:
            return self._store.number(511, 5.0)
        return self._store.number(512, 10.0) if self.word & words.JOG_2 else 0.0

    def _reference_hz(self) -> float:
        return (self._store.number(516) + self._offset) / 100 * self._motor.maximum_hz

    def _has_inhibit(self) -> bool:
        return self._store.number(309) == _INHIBIT

    def _is_local(self) -> bool:
        return self._store.number(3) in _LOCAL
