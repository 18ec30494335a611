"""Reaction of an FC drive to control words: its motor, its status word, its functions, its watchdog.

Specification, section 12. Where the manuals leave the order of stops open, the order in which section 14 names the
words is used. The status word is determined before a command is obeyed (VLT 5000 Design Guide p. 95).
"""

from __future__ import annotations

import math
from functools import cache
from typing import TYPE_CHECKING

from drivecomm.profiles import have_do
from drivecomm.protocol import Command
from drivecomm_danfoss_fc import words
from drivecomm_danfoss_fc.words import has

if TYPE_CHECKING:
    from drivecomm.profiles import MotorDoes
    from drivecomm.protocol import Motor
    from drivecomm_danfoss_fc.options import DanfossFcOptions
    from drivecomm_danfoss_fc.store import Store

CONTROL_WORD_TIMEOUT = 17
"""Alarm "control word timeout"; the number is general knowledge of the FC series."""

_RPM = 67
"""Conversion index of a speed in rpm; the jogs of PROFIdrive are in rpm on FC drives and in Hz on VLT drives."""

_GATES = (
    ("gate_coast", words.COAST_BIT, True),
    ("gate_quick_stop", words.QUICK_STOP_BIT, True),
    ("gate_dc_brake", words.DC_BRAKE_BIT, True),
    ("gate_start", words.START_BIT, False),
    ("gate_reverse", words.REVERSE_BIT, False),
)
"""Role of the parameter that gates a bit, the bit, and its level if the bus may not set it (value 0, digital input)."""


class Machine:
    """Reaction of one drive to the bus over time.

    local: operated at the keypad, so that bus commands have no effect. locked: the trip is a trip lock, and mains must
    be cycled. conditions: status bits that the motor does not produce by itself (4, 5, 12 to 15), for tests. word,
    reference: the last valid control word and its reference. full: the reference for 100 %. set_up, relays: as selected
    by bits 13 and 14, and by bits 11 and 12.
    """

    def __init__(self, motor: Motor, store: Store, options: DanfossFcOptions) -> None:
        self.motor = motor
        self.local = False
        self.locked = False
        self.conditions = 0
        self._store = store
        self._options = options
        self.full = words.profile(profidrive=False).full
        self._fc_profile = store.fact("profile", "fc_value", 0)
        self._asks = [cache(words.profile(profidrive=each).asks) for each in (False, True)]
        self._gates = [gate for gate in _GATES if store.has(gate[0])]
        self.power_up()

    def power_up(self) -> None:
        """Begin as after a power-up."""
        self.word = words.IGNORED
        self.reference = 0
        self.set_up = 1
        self.relays = [False, False]
        self.timed_out = False
        self._valid_at: float | None = None
        self._trips_when_stopped = False
        self._on = False
        self._caught_up = 0.0

    @property
    def profidrive(self) -> bool:
        """Whether control words are read as PROFIdrive; 8-10 (512) decides if the drive has it."""
        if not self._store.has("profile"):
            return self._options.profile == "profidrive"
        return self._store.setting("profile", 0) != self._fc_profile

    def control(self, word: int, reference: int, now: float) -> None:
        """Obey a control word; one without bit 10 is ignored as a whole, together with its reference."""
        if not has(word, words.VALID_BIT):
            return
        self._valid_at = now
        if self.timed_out:
            self.timed_out = self._trips_when_stopped = self.motor.warning = False
        if self.local:
            return
        previous, self.word, self.reference = self.word, word, reference
        if self.motor.fault and not self.locked and has(word, words.RESET_BIT) and not has(previous, words.RESET_BIT):
            self.motor.reset(now)
        multi = self._store.fact("active_set_up", "multi", 0)
        if self._allowed("gate_set_up") and self._store.setting("active_set_up", 0) == multi:
            self.set_up = 1 + (word >> words.SET_UP_BIT & 0b11)
        if self.profidrive:
            self._profidrive_functions(word, previous)
        else:
            self.relays = self._tied_relays(has(word, words.RELAY_1_BIT), has(word, words.RELAY_2_BIT))
        self._move(now)

    def watch(self, now: float) -> None:
        """Advance the time: the control word timeout, a stop that ends in a trip, the motor."""
        function = round(self._store.setting("timeout_function", 0))
        if function and self._valid_at is not None and not self.timed_out:
            deadline = self._valid_at + self._store.setting("timeout_s", math.inf)
            if now > deadline:
                self._time_out(function, deadline)
        self.motor.advance(now)
        if self._trips_when_stopped and not self.motor.running:
            self._trips_when_stopped = False
            self.motor.trip(CONTROL_WORD_TIMEOUT, now)
        if self.motor.fault:
            self._on = False

    def status_word(self) -> int:
        """Return the status word of the selected profile."""
        motor, fault, asked = self.motor, bool(self.motor.fault), self._asked()
        coasting, (low, high) = asked == "off", self._limits()
        bits = {
            words.CONTROL_READY: not fault,
            words.DRIVE_READY: not fault,
            words.ENABLED: not fault and not coasting,
            words.TRIP: fault,
            words.WARNING: motor.warning,
            words.AT_REFERENCE: motor.at_reference,
            words.BUS_CONTROL: not self.local,
            words.IN_LIMITS: low <= abs(motor.output_hz) <= high,
            words.RUNNING: motor.running,
        }
        if self.profidrive:
            off_2, off_3 = coasting, asked == "quick"
            active = self._options.off_bit_when_active
            bits |= {words.ENABLED: self._on and not coasting}
            bits |= {4: off_2 == active, 5: off_3 == active, 6: fault or off_2 or off_3}
        else:
            bits[words.TRIP_LOCK] = fault and self.locked
        return sum([1 << bit for bit, on in bits.items() if on]) | self.conditions

    def main_actual(self) -> int:
        """Return the actual value: the output frequency on the scale of the series."""
        hz = self.motor.output_hz
        if hz == 0:
            return 0
        low, high = self._reference_span() if self._options.actual_scaling == "reference" else self._limits()
        low = max(low, 0.0)
        share = math.copysign(abs(hz) - low, hz) / (high - low) if high > low else 0.0
        return max(-(2**15), min(2**15 - 1, round(share * self.full)))

    def reference_percent(self) -> float:
        """Return the reference in force: the sum of bus reference and preset, or one of them."""
        percent = self.reference * 100 / self.full + self._caught_up
        if not self.profidrive and self._allowed("gate_preset"):
            place = self.word & 0b11
            role, element = ("preset", place) if self._store.has("preset") else (f"preset_{place + 1}", 0)
            preset = self._store.setting(role, 0.0, element)
            percent = percent + preset if self._options.presets_added else preset or percent
        return max(-100.0, min(100.0, percent))

    def _move(self, now: float) -> None:
        store, motor = self._store, self.motor
        motor.rated_hz = store.setting("rated_hz", motor.rated_hz)
        motor.maximum_hz = self._limits()[1]
        # The tables name no ramp-down time for ramp 2, so the ramp-up time serves for both.
        second = has(self.word, words.RAMP_2_BIT) and not self.profidrive and store.has("ramp_2")
        motor.ramp_up_s = store.setting("ramp_2" if second else "ramp_up", motor.ramp_up_s)
        motor.ramp_down_s = store.setting("ramp_2" if second else "ramp_down", motor.ramp_down_s)
        motor.quick_ramp_s = store.setting("quick_ramp", motor.quick_ramp_s)
        if motor.fault:
            return
        asked = self._asked()
        if asked == "run" and self.profidrive and not self._on:
            asked = "ramp"
        have_do(motor, asked, lambda: self._directed(self._wanted_hz()), now)

    def _asked(self) -> MotorDoes:
        """Return the action that the word in force demands of the motor.

        Bits that the bus may not set have the level of their digital input.
        """
        if not self.word:
            return "ramp"
        word = self.word
        profidrive = self.profidrive
        for role, bit, level in self._gates:
            if not self._allowed(role) and not (profidrive and role == "gate_dc_brake"):
                word = word | 1 << bit if level else word & ~(1 << bit)
        return self._asks[profidrive](word)

    def _wanted_hz(self) -> float:
        first, second = has(self.word, words.JOG_1_BIT), has(self.word, words.JOG_2_BIT)
        if first and not self.profidrive:
            return self._store.setting("jog_hz", 5.0)
        if self.profidrive and (first or second):
            role = "bus_jog_1" if first else "bus_jog_2"
            in_rpm = self._store.fact(role, "conversion_index", 0) == _RPM
            speed = self._store.setting(role, 5.0)
            return speed * self.motor.rated_hz / self.motor.rated_rpm if in_rpm else speed
        low, high = self._reference_span()
        percent = self.reference_percent()
        if self._store.setting("range", 0):
            return percent * high / 100
        # With the range "minimum to maximum" a negative reference stays at the minimum.
        return low + max(0.0, percent) * (high - low) / 100

    def _directed(self, hz: float) -> float:
        if has(self.word, words.REVERSE_BIT) and self._allowed("gate_reverse"):
            hz = -hz
        if hz < 0 and self._store.setting("direction", 2) == 0:
            return 0.0
        return math.copysign(max(abs(hz), self._limits()[0]), hz)

    def _reference_span(self) -> tuple[float, float]:
        high = self._store.setting("reference_maximum", 50.0)
        return (-high if self._store.setting("range", 0) else self._store.setting("reference_minimum", 0.0)), high

    def _limits(self) -> tuple[float, float]:
        """Return the lowest and the highest output frequency, in Hz."""
        return self._store.setting("low_limit", 0.0), self._store.setting("high_limit", 50.0)

    def _allowed(self, role: str) -> bool:
        return self._store.setting(role, 3) != 0

    def _tied_relays(self, first: bool, second: bool) -> list[bool]:
        """Return the relays as set by the bits to which 5-40 ties them: [36] bit 11, [37] bit 12."""
        if not self._store.has("relay"):
            return [first, second]
        bits = {36: first, 37: second}
        return [bits.get(round(self._store.setting("relay", 0, place)), False) for place in (0, 1)]

    def _profidrive_functions(self, word: int, previous: int) -> None:
        """Switch on at a rising edge of bit 0 after a valid word, off with OFF1, OFF2 or OFF3; catch up, slow down."""
        off = not (has(word, words.ON_BIT) and has(word, words.OFF2_BIT) and has(word, words.OFF3_BIT))
        if off:
            self._on, self._caught_up = False, 0.0
        elif has(previous, words.VALID_BIT) and not has(previous, words.ON_BIT) and not self.motor.fault:
            self._on = True
        step = float(self._options.catch_up_percent)
        for bit, sign in ((words.CATCH_UP_BIT, 1), (words.SLOW_DOWN_BIT, -1)):
            if has(word, bit) and not has(previous, bit):
                self._caught_up += sign * step

    def _time_out(self, function: int, deadline: float) -> None:
        """Carry out the action of 8-04.

        1 freeze, 2 stop, 3 jog, 4 maximum speed, 5 stop and trip, 7 to 10 set-up 1 to 4.
        """
        motor = self.motor
        self.timed_out = motor.warning = True
        self.relays = [False, False]
        if function == 1:
            motor.stop(Command.HOLD, deadline)
        elif function in (2, 5):
            motor.stop(Command.RAMP_STOP, deadline)
            self._trips_when_stopped = function == 5
        elif function in (3, 4) and motor.running:
            hz = self._store.setting("jog_hz", 5.0) if function == 3 else self._limits()[1]
            motor.run(math.copysign(hz, motor.output_hz), deadline)
        elif function >= 7:
            self.set_up = function - 6
