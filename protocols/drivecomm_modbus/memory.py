"""What a virtual Modbus drive holds: registers and coils, those in EEPROM, and what its motor shows in them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.errors import ParameterAddressError
from drivecomm.protocol import Command
from drivecomm_modbus.parameters import Place, target

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from drivecomm.protocol import Model, Motor
    from drivecomm_modbus.control import Control
    from drivecomm_modbus.options import ModbusOptions
    from drivecomm_modbus.parameters import Target

_MEASURED: dict[str, Callable[[Motor], float]] = {
    "output_frequency": lambda motor: abs(motor.output_hz),
    "output_current": lambda motor: motor.current_a,
    "output_voltage": lambda motor: motor.voltage_v,
    "output_power": lambda motor: motor.power_kw,
    "dc_link_voltage": lambda motor: motor.dc_link_v,
    "torque_percent": lambda motor: motor.torque_percent,
    "motor_speed": lambda motor: abs(motor.speed_rpm),
    "heat_sink_temperature": lambda motor: motor.temperature_c,
}


class Memory:
    """The registers of a drive of one model. `words`: what they hold now, by kind and wire address."""

    def __init__(self, model: Model, options: ModbusOptions, control: Control, motor: Motor) -> None:
        self._model, self._options, self._control, self._motor = model, options, control, motor
        self.words: dict[tuple[str, int], int] = {}
        self.targets = {address: target(address, model, options) for address in model.parameters}
        for each in self.targets.values():
            self._begin_with(each)
        for place in self._commanded():
            self.words.setdefault((place.kind, place.start), 0)
        self._stored = dict(self.words)

    def _begin_with(self, wanted: Target) -> None:
        """Put what the model says that a parameter starts with into its registers, 0 where it says nothing."""
        for spot in wanted.spots:
            self.words.setdefault(spot, 0)
        info = wanted.info
        if info is None or info.start is None:
            return
        if isinstance(info.start, str):
            self.put(wanted, info.start)
        elif wanted.type == "f32":
            self.put(wanted, wanted.raw_for(info.start))
        else:
            self.put(wanted, int(info.start / info.factor) & 0xFFFFFFFF)

    def _commanded(self) -> Iterator[Place]:
        for steps in self._control.steps.values():
            yield from (step.place for step in steps)
        yield from self._control.status_places

    def known(self, parameter: str) -> Target:
        """Return a parameter that the drive holds, raises ParameterAddressError."""
        found = target(parameter, self._model, self._options)
        if (found.place.kind, found.place.start) not in self.words:
            raise ParameterAddressError(f"the virtual drive holds no parameter {parameter!r}")
        return found

    def fetch(self, wanted: Target) -> int | str:
        """Return what a parameter holds."""
        kind, start = wanted.place.kind, wanted.place.start
        if wanted.wide:
            return self.words[kind, start]
        return wanted.raw_of([self.words[kind, start + offset] for offset in range(wanted.size)])

    def put(self, wanted: Target, raw: int | str) -> None:
        """Set what a parameter holds."""
        kind, start = wanted.place.kind, wanted.place.start
        if wanted.place.part:
            self.words[kind, start] = wanted.place.put(self.words[kind, start], int(raw))
            return
        if wanted.wide:
            self.words[kind, start] = int(raw)
            return
        for offset, word in enumerate(wanted.words_of(raw)):
            self.words[kind, start + offset] = word

    def show(self) -> None:
        """Put what the motor does into the registers that tell it."""
        motor, model = self._motor, self._model
        for name, measure in _MEASURED.items():
            address = model.quantities.get(name)
            if address in self.targets and (info := self.targets[address].info) is not None and info.access == "r":
                self.put(self.targets[address], round(measure(motor) / float(info.factor)) & 0xFFFFFFFF)
        if self._control.fault_code:
            self.put(self.targets[self._control.fault_code], motor.fault)
        self._show_status()

    def _show_status(self) -> None:
        """Set each status register to what its conditions say: first those that do not hold, then those that do."""
        motor = self._motor
        # The later ones win where two look at the same bits.
        truth = {
            "always": True,
            "remote": True,
            "ready": not motor.fault,
            "running": motor.running,
            "reverse": motor.output_hz < 0,
            "at_reference": motor.at_reference,
            "warning": motor.warning,
            "stopping": motor.command is Command.QUICK_STOP,
            "fault": bool(motor.fault),
        }
        words = dict.fromkeys(((place.kind, place.start) for place in self._control.status_places), 0)
        conditions = [
            (self._control.status[name], holds) for name, holds in truth.items() if name in self._control.status
        ]
        for condition, holds in sorted(conditions, key=lambda each: each[1]):
            place, spot = condition.place, (condition.place.kind, condition.place.start)
            part = place.cut(words[spot])
            if holds:
                part = part & ~condition.mask | condition.values[0]
            elif condition.holds(part):
                part ^= condition.mask
            words[spot] = place.put(words[spot], part)
        self.words.update(words)

    def keep(self, kind: str, start: int) -> None:
        """Take a register over into EEPROM."""
        self._stored[kind, start] = self.words[kind, start]

    def keep_all(self) -> None:
        """Take all registers over into EEPROM, but for commands and what is volatile by itself."""
        volatile = [each.spots for each in self.targets.values() if each.info and each.info.storage == "volatile"]
        left_out = frozenset().union(*volatile)
        self._stored.update({spot: word for spot, word in self.words.items() if spot not in left_out})

    def power_cycle(self) -> None:
        """Forget what is not in EEPROM."""
        self.words = dict(self._stored)
