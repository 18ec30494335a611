"""Reference of one drive in each of its units: hertz and per cent as the drive takes them, others as hertz."""

from __future__ import annotations

from decimal import Decimal
from typing import TYPE_CHECKING

from drivecomm.errors import NotSupported, UsageError, shortened
from drivecomm.protocol import exact

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.bus.reference_limits import ReferenceLimits
    from drivecomm.protocol import Exchange, MachineUnit, Operations, Reading, Value


class ReferenceExchanges:
    """Factory of the exchanges that set the reference of one drive.

    name: name of the drive. limits: the highest references that it accepts. read: returns an exchange that reads a
    common name; None if its model does not know it. machine: the unit in which its machine counts its speed; None if
    unknown.
    """

    def __init__(
        self,
        name: str,
        operations: Operations,
        limits: ReferenceLimits,
        read: Callable[[str], Exchange[Reading] | None],
        machine: MachineUnit | None,
    ) -> None:
        _check_machine(machine, name)
        self.machine = machine
        self._name, self._operations, self._limits, self._read = name, operations, limits, read

    def to_set(
        self,
        percent: Value | float | None,
        hz: Value | float | None,
        rpm: Value | float | None,
        machine: Value | float | None,
    ) -> Exchange[None]:
        """Set the reference in one of its units. Raises ValueRefusedError if it is above the drive's maximum."""
        if sum(given is not None for given in (percent, hz, rpm, machine)) != 1:
            raise UsageError("give the reference as one of percent, hz, rpm and machine")
        if machine is not None:
            return self._set_hz(self.machine_hz(machine))
        if percent is not None:
            share = exact(percent, "reference")
            self._limits.check_percent(share)
            return self._operations.set_reference_percent(share)
        if hz is not None:
            return self._set_hz(exact(hz, "reference"))
        return self._set_rpm(exact(rpm if rpm is not None else 0, "reference"))

    def machine_hz(self, value: Value | float) -> Decimal:
        """Return the frequency for a speed of the machine. Raises NotSupported if the machine's unit is unknown."""
        if self.machine is None:
            raise NotSupported(
                f'the machine unit of {self._name} is unknown; write machine = {{ unit = "m/min", '
                'per_hz = "1.25" } in its [[drive]] of the plant file, or give the reference in hertz'
            )
        return self.machine.reference_hz(value)

    def forget_maximum(self) -> None:
        """Read the drive's maximum again for the next reference, because a parameter of the drive is written."""
        self._limits.forget()

    def _set_hz(self, hz: Decimal) -> Exchange[None]:
        self._limits.check_hz(hz)
        return self._limits.within(hz, self._operations.set_reference_hz(hz))

    def _set_rpm(self, rpm: Decimal) -> Exchange[None]:
        frequency, speed = self._rated("motor_rated_frequency"), self._rated("motor_rated_speed")
        if not self._operations.capabilities.reference_hz:
            raise NotSupported(f"{self._name} takes its reference in percent only; see its options for hertz")
        return self._converted_from_rpm(rpm, frequency, speed)

    def _rated(self, name: str) -> Exchange[Reading]:
        reading = self._read(name)
        if reading is None:
            raise NotSupported(f"{self._name} has no {name} in its model, so rpm cannot be converted; use hz")
        return reading

    def _converted_from_rpm(
        self, rpm: Decimal, frequency: Exchange[Reading], speed: Exchange[Reading]
    ) -> Exchange[None]:
        rated_frequency = yield from frequency
        rated_speed = yield from speed
        yield from self._set_hz(frequency_for(rpm, rated_frequency, rated_speed))


def frequency_for(rpm: Decimal, rated_frequency: Reading, rated_speed: Reading) -> Decimal:
    """Return the frequency at which a motor with this name plate turns at `rpm` without load, to 0.01 Hz.

    The number of pole pairs from the name plate is rounded down to a whole number: slip makes a motor slower than its
    field. Raises UsageError for an empty name plate.
    """
    if isinstance(rated_frequency.value, str) or isinstance(rated_speed.value, str) or not rated_speed.value:
        raise UsageError("the drive holds no name plate data of its motor, so rpm cannot be converted; use hz")
    pole_pairs = int(60 * Decimal(rated_frequency.value) / Decimal(rated_speed.value))
    if pole_pairs < 1:
        raise UsageError(
            f"a motor of {rated_frequency} with {rated_speed} has no pole pairs; correct its name plate in the drive"
        )
    return exact(rpm * pole_pairs / 60, "reference").quantize(Decimal("0.01"))


def _check_machine(machine: object, drive: str) -> None:
    if machine is None:
        return
    # Imported here, because only a drive with a machine unit needs exact fractions.
    from drivecomm.protocol import MachineUnit

    if not isinstance(machine, MachineUnit):
        raise UsageError(f"invalid machine of {drive}: {shortened(machine)}; give a drivecomm.MachineUnit")
