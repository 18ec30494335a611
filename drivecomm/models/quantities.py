"""Common names: quantities that drives of every maker have, with definitions and units; and conversion of units.

The registry is `quantities.toml` beside this module. A model maps them to its parameters under `[quantities]`.
"""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal
from functools import cache
from types import MappingProxyType
from typing import TYPE_CHECKING

from drivecomm.errors import ParameterAddressError, UsageError
from drivecomm.protocol import exact, new_reading

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.protocol import Model, ParameterInfo, Reading, Value

TEXT_QUANTITIES = frozenset({"software_version", "serial_number", "drive_type"})
"""Common names of quantities that are texts, or may be; all others are numbers."""


@dataclass(frozen=True, slots=True)
class Quantity:
    """A common name. unit: unit of its readings on every drive; empty for a number or a text without a unit."""

    name: str
    unit: str
    meaning: str


@cache
def quantities() -> Mapping[str, Quantity]:
    """Return all common names, in the order of the registry."""
    import tomllib
    from importlib import resources

    content = tomllib.loads(resources.files("drivecomm.models").joinpath("quantities.toml").read_text(encoding="utf-8"))
    return MappingProxyType({name: Quantity(name, entry["unit"], entry["meaning"]) for name, entry in content.items()})


class CommonName:
    """A common name on the drives of one model: its parameter there, and the unit of that parameter."""

    def __init__(self, name: str, model: Model) -> None:
        self.quantity = quantities()[name]
        self.address = model.quantities[name]
        info = parameter_at(self.address, model)
        self._unit = info.unit if info else ""

    def convert(self, reading: Reading) -> Reading:
        """Return a reading of the parameter as a reading of the quantity, with its name and unit."""
        value, unit, asked = reading.value, reading.unit, self.quantity
        if unit != asked.unit and not isinstance(value, str):
            value, unit = converted(Decimal(value), unit, asked.unit), asked.unit
        return new_reading(
            parameter=reading.parameter,
            value=value,
            raw=reading.raw,
            unit=unit,
            type=reading.type,
            name=asked.name,
            text=reading.text,
            note=reading.note,
            doubt=reading.doubt,
            time_s=reading.time_s,
        )

    def to_drive_unit(self, value: Value | float) -> Value | float:
        """Return a value converted from the quantity's unit to the parameter's. Raises ValueRefusedError for a text."""
        if self._unit == self.quantity.unit:
            return value
        return converted(exact(value, self.address), self.quantity.unit, self._unit)


def parameter_at(address: str, model: Model) -> ParameterInfo | None:
    """Return the parameter at an address in the model: the element itself, or the parameter that it is part of."""
    return model.find(address) or model.find(address.partition("[")[0])


def unmapped_name_error(name: str, model: Model | None) -> ParameterAddressError:
    """Return the error for a common name that a drive's model does not map."""
    whose = f"model {model.name} does" if model else "a drive without a model does"
    return ParameterAddressError(f"{whose} not say which parameter is the {name}; give its address")


# For each unit: its base unit, and its size in that unit. Only conversions that are exact in decimal.
_PARTS: dict[str, tuple[str, Decimal]] = {
    "kHz": ("Hz", Decimal(1000)),
    "mA": ("A", Decimal("0.001")),
    "mV": ("V", Decimal("0.001")),
    "kV": ("V", Decimal(1000)),
    "W": ("kW", Decimal("0.001")),
    "Wh": ("kWh", Decimal("0.001")),
    "MWh": ("kWh", Decimal(1000)),
    "ms": ("s", Decimal("0.001")),
    "min": ("s", Decimal(60)),
    "1/min": ("rpm", Decimal(1)),
    "deg C": ("degC", Decimal(1)),
    "°C": ("degC", Decimal(1)),
}


def factor_between(given: str, wanted: str) -> Decimal | None:
    """Return the factor that converts a number from one unit to another; None if none is known exactly."""
    if given == wanted:
        return Decimal(1)
    counted, parts = _PARTS.get(given, (given, Decimal(1)))
    into, of = _PARTS.get(wanted, (wanted, Decimal(1)))
    if counted != into:
        return None
    return (parts / of).normalize()


def converted(value: Decimal, given: str, wanted: str) -> Decimal:
    """Return a value converted to another unit. Raises UsageError if the units do not fit."""
    factor = factor_between(given, wanted)
    if factor is None:
        raise UsageError(f"{given or 'a number without unit'} cannot be given in {wanted or 'a number without unit'}")
    return value if factor == 1 else value * factor
