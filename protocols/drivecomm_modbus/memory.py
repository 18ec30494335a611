"""What a virtual Modbus drive holds: registers and coils, those in EEPROM, and what its motor shows in them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.errors import ParameterAddressError
from drivecomm_modbus.parameters import target

if TYPE_CHECKING:
    from drivecomm.protocol import Model, Motor
    from drivecomm_modbus.control import Control
    from drivecomm_modbus.options import ModbusOptions
    from drivecomm_modbus.parameters import Target


class Memory:
    """The registers of a drive of one model. `words`: what they hold now, by the name of their place."""

    def __init__(self, model: Model, options: ModbusOptions, control: Control) -> None:
        self._model, self._options, self._control = model, options, control
        self.words: dict[str, int] = {}
        self.targets = {address: target(address, model, options) for address in model.parameters}
        for each in self.targets.values():
            self._begin_with(each)
        profile = control.profile
        commands = [profile.start, profile.start_reverse, profile.reset, *profile.stops.values()]
        for steps in (*commands, *control.storing.values()):
            self.words.update({step.place: 0 for step in steps if step.place not in self.words})
        self.words.update({each.place: 0 for each in control.status.values() if each.place not in self.words})
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
        elif wanted.format.type == "f32":
            self.put(wanted, wanted.raw_for(info.start))
        else:
            self.put(wanted, int(info.start / info.factor) & 0xFFFFFFFF)

    def known(self, parameter: str) -> Target:
        """Return a parameter that the drive holds, raises ParameterAddressError."""
        found = target(parameter, self._model, self._options)
        if found.place.name not in self.words:
            raise ParameterAddressError(f"the virtual drive holds no parameter {parameter!r}")
        return found

    def fetch(self, wanted: Target) -> int | str:
        """Return what a parameter holds."""
        words = [self.words[spot] for spot in wanted.spots]
        return words[0] if wanted.wide else wanted.raw_of(words)

    def put(self, wanted: Target, raw: int | str) -> None:
        """Set what a parameter holds."""
        place = wanted.place
        if place.part:
            self.words[place.name] = place.put(self.words[place.name], int(raw))
        elif wanted.wide:
            self.words[place.name] = int(raw)
        else:
            self.words.update(zip(wanted.spots, wanted.format.words_of(raw), strict=True))

    def show(self, motor: Motor) -> None:
        """Put what the motor does into the registers that tell it."""
        for name, address in self._model.quantities.items():
            wanted, measured = self.targets.get(address), motor.measured(name)
            if measured is not None and wanted and wanted.info and wanted.info.access == "r":
                self.put(wanted, round(measured / float(wanted.info.factor)) & 0xFFFFFFFF)
        if self._control.fault_code:
            self.put(self.targets[self._control.fault_code], motor.fault)

    def keep(self, names: list[str]) -> None:
        """Take registers over into EEPROM."""
        self._stored.update({name: self.words[name] for name in names})

    def keep_all(self) -> None:
        """Take all registers over into EEPROM, but for commands and what is volatile by itself."""
        volatile = {
            spot
            for each in self.targets.values()
            if each.info and each.info.storage == "volatile"
            for spot in each.spots
        }
        self.keep([name for name in self.words if name not in volatile])

    def power_cycle(self) -> None:
        """Forget what is not in EEPROM."""
        self.words = dict(self._stored)
