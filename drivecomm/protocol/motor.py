"""The simulated motor of every virtual drive, which changes over time after a command."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from operator import attrgetter

MOTOR_DATA = frozenset({
    "rated_hz", "rated_v", "rated_a", "rated_kw", "rated_rpm", "maximum_hz", "ramp_up_s", "ramp_down_s",
    "quick_ramp_s", "coast_s", "dc_brake_s", "load", "mains_v", "ambient_c",
})  # fmt: skip
"""Fields of `Motor` that a user can configure: name plate, ramps, load, mains and surroundings."""


class Command(Enum):
    """Action of a drive on its motor."""

    OFF = "off"
    RUN = "run"
    RAMP_STOP = "ramp_stop"
    QUICK_STOP = "quick_stop"
    DC_BRAKE = "dc_brake"
    HOLD = "hold"


@dataclass(slots=True, kw_only=True)
class Motor:
    """A motor with ramps, on a drive with a DC link.

    Methods in which time passes take the present time in seconds as an argument. rated_hz, rated_v, rated_a, rated_kw,
    rated_rpm: the name plate. maximum_hz: limit of the output frequency. ramp_up_s, ramp_down_s, quick_ramp_s: from
    standstill to rated_hz and back. load: torque as a share of the rated torque. mains_v: line voltage. Frequencies are
    signed: negative is reverse.
    """

    rated_hz: float = 50.0
    rated_v: float = 400.0
    rated_a: float = 8.0
    rated_kw: float = 4.0
    rated_rpm: float = 1450.0
    maximum_hz: float = 50.0
    ramp_up_s: float = 5.0
    ramp_down_s: float = 5.0
    quick_ramp_s: float = 1.0
    coast_s: float = 3.0
    dc_brake_s: float = 1.0
    load: float = 0.6
    mains_v: float = 400.0
    ambient_c: float = 25.0
    output_hz: float = 0.0
    shaft_hz: float = 0.0
    target_hz: float = 0.0
    command: Command = Command.OFF
    fault: int = 0
    warning: bool = False
    temperature_c: float = 30.0
    running_s: float = 0.0
    energy_kwh: float = 0.0
    time: float = 0.0

    def run(self, hz: float, now: float) -> None:
        """Run at this frequency; no effect while the drive is tripped."""
        self.advance(now)
        if not self.fault:
            self.command = Command.RUN
            self.target_hz = max(-self.maximum_hz, min(self.maximum_hz, hz))

    def stop(self, how: Command, now: float) -> None:
        """Stop by coasting (OFF), RAMP_STOP, QUICK_STOP or DC_BRAKE, or HOLD the output as it is."""
        self.advance(now)
        if self.command is Command.OFF and how is not Command.OFF:
            return
        self.command = how
        if how is not Command.HOLD:
            self.target_hz = 0.0
        if how is Command.OFF:
            self.output_hz = 0.0

    def trip(self, code: int, now: float) -> None:
        """Switch the output off with this fault code. Raises ValueError for code 0, which means no fault."""
        if code == 0:
            raise ValueError("fault code 0 means no fault")
        self.stop(Command.OFF, now)
        self.fault = code

    def reset(self, now: float) -> None:
        """Acknowledge the fault; the motor stays off."""
        self.advance(now)
        self.fault = 0

    def advance(self, now: float) -> None:
        """Advance the motor to the time `now`; a time in the past is ignored."""
        elapsed = now - self.time
        if elapsed <= 0:
            return
        self.time = now
        if self.command is Command.OFF:
            self.shaft_hz = _towards(self.shaft_hz, 0.0, self.rated_hz / self.coast_s * elapsed)
            self._warm(elapsed)
            return
        before = self.output_hz
        if self.command is Command.DC_BRAKE:
            self.output_hz = _towards(before, 0.0, self.rated_hz / self.dc_brake_s * elapsed)
        elif self.command is not Command.HOLD:
            self.output_hz = self._ramped(before, elapsed)
        self.shaft_hz = self.output_hz
        self.running_s += elapsed
        self.energy_kwh += self.power_kw * elapsed / 3600
        if self.output_hz == 0 and self.command in (Command.RAMP_STOP, Command.QUICK_STOP, Command.DC_BRAKE):
            self.command = Command.OFF
        self._warm(elapsed)

    def _ramped(self, start: float, elapsed: float) -> float:
        down = self.quick_ramp_s if self.command is Command.QUICK_STOP else self.ramp_down_s
        if start * self.target_hz >= 0 and abs(self.target_hz) > abs(start):
            return _towards(start, self.target_hz, self._slope(self.ramp_up_s) * elapsed)
        # Ramp down first, to zero at most, then up again in the other direction.
        to_zero = self.target_hz if start * self.target_hz > 0 else 0.0
        slope = self._slope(down)
        needed = abs(start - to_zero) / slope
        if elapsed <= needed or to_zero == self.target_hz:
            return _towards(start, to_zero, slope * elapsed)
        return _towards(0.0, self.target_hz, self._slope(self.ramp_up_s) * (elapsed - needed))

    def _slope(self, ramp_s: float) -> float:
        return self.rated_hz / ramp_s if ramp_s > 0 else math.inf

    def _warm(self, elapsed: float) -> None:
        final = self.ambient_c + (40.0 * self.load if self.running else 5.0)
        self.temperature_c += (final - self.temperature_c) * (1 - math.exp(-elapsed / 300.0))

    @property
    def running(self) -> bool:
        """Whether the output is on."""
        return self.command is not Command.OFF

    @property
    def at_reference(self) -> bool:
        """Whether the motor runs at the frequency that was commanded."""
        return self.command is Command.RUN and self.output_hz == self.target_hz

    @property
    def accelerating(self) -> bool:
        """Whether the output frequency rises."""
        return self.command is Command.RUN and self._away_from_zero and abs(self.target_hz) > abs(self.output_hz)

    @property
    def decelerating(self) -> bool:
        """Whether the output frequency falls."""
        if not self.running or self.command is Command.HOLD:
            return False
        return not self._away_from_zero or abs(self.target_hz) < abs(self.output_hz)

    @property
    def _away_from_zero(self) -> bool:
        """Whether the target lies on the same side of zero as the output frequency."""
        return self.output_hz * self.target_hz >= 0

    def measured(self, quantity: str) -> float | None:
        """Return the value that a drive shows for a common name; None if the name does not concern the motor."""
        read = _MEASURED.get(quantity)
        value: float | None = None if read is None else read(self)
        return abs(value) if value is not None and quantity in ("output_frequency", "motor_speed") else value

    @property
    def speed_rpm(self) -> float:
        """Shaft speed, in revolutions a minute."""
        return self.shaft_hz / self.rated_hz * self.rated_rpm

    @property
    def current_a(self) -> float:
        """Motor current, in A: magnetising share and load share."""
        return self.rated_a * math.hypot(0.4, 0.9165 * self.load) if self.running else 0.0

    @property
    def voltage_v(self) -> float:
        """Motor voltage, in V: proportional to the frequency up to the rated frequency."""
        return self.rated_v * min(1.0, abs(self.output_hz) / self.rated_hz) if self.running else 0.0

    @property
    def power_kw(self) -> float:
        """Power taken by the motor, in kW."""
        return self.rated_kw * self.load * abs(self.output_hz) / self.rated_hz if self.running else 0.0

    @property
    def torque_percent(self) -> float:
        """Torque in per cent of the rated torque, signed with the direction."""
        return math.copysign(self.load * 100, self.output_hz) if self.running and self.output_hz else 0.0

    @property
    def torque_nm(self) -> float:
        """Torque in newton metres, signed with the direction."""
        return self.torque_percent / 100 * self.rated_kw * 9550 / self.rated_rpm

    @property
    def dc_link_v(self) -> float:
        """DC-link voltage, in V: the rectified mains, slightly higher while the motor brakes."""
        return self.mains_v * math.sqrt(2) * (1.08 if self.decelerating else 1.0)


def _towards(value: float, goal: float, step: float) -> float:
    return max(goal, value - step) if value > goal else min(goal, value + step)


_MEASURED = {
    name: attrgetter(field)
    for name, field in (
        ("output_frequency", "output_hz"),
        ("output_current", "current_a"),
        ("output_voltage", "voltage_v"),
        ("output_power", "power_kw"),
        ("dc_link_voltage", "dc_link_v"),
        ("torque", "torque_nm"),
        ("torque_percent", "torque_percent"),
        ("motor_speed", "speed_rpm"),
        ("heat_sink_temperature", "temperature_c"),
    )
}
