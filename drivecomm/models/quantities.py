"""Common names: quantities that drives of every maker have, each with its definition and its unit; and other units.

The registry is `quantities.toml` beside this module. A model says under `[quantities]` which of its parameters each is.
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
"""Common names of what is a text, or may be one; all others are numbers."""


@dataclass(frozen=True, slots=True)
class Quantity:
    """A common name. unit: of every reading of it, on every drive; empty for a number or a text without one."""

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
    """A common name on the drives of one model: which parameter it is there, and in which unit that one is."""

    def __init__(self, name: str, model: Model) -> None:
        self.quantity = quantities()[name]
        self.address = model.quantities[name]
        info = parameter_at(self.address, model)
        self._unit = info.unit if info else ""

    def told(self, reading: Reading) -> Reading:
        """Return a reading of the parameter as one of the quantity: under its name, in its unit."""
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

    def given(self, value: Value | float) -> Value | float:
        """Return a value in the quantity's unit as one in the parameter's. Raises ValueRefusedError for no number."""
        if self._unit == self.quantity.unit:
            return value
        return converted(exact(value, self.address), self.quantity.unit, self._unit)


def parameter_at(address: str, model: Model) -> ParameterInfo | None:
    """Return what a model knows of an address: of the element itself, or else of the parameter that it is part of."""
    return model.find(address) or model.find(address.partition("[")[0])


def not_said(name: str, model: Model | None) -> ParameterAddressError:
    """Return the error for a common name that a drive's model does not map."""
    whose = f"model {model.name} does" if model else "a drive without a model does"
    return ParameterAddressError(f"{whose} not say which parameter is the {name}; give its address")


# Unit, unit that it is counted in, and how many of those it is. Only what a decimal number says exactly.
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
    """Return what a number in one unit is multiplied by to be in another; None where that is not known exactly."""
    if given == wanted:
        return Decimal(1)
    counted, parts = _PARTS.get(given, (given, Decimal(1)))
    into, of = _PARTS.get(wanted, (wanted, Decimal(1)))
    if counted != into:
        return None
    return (parts / of).normalize()


def converted(value: Decimal, given: str, wanted: str) -> Decimal:
    """Return a value in another unit, without zeros behind it that say nothing. Raises UsageError."""
    factor = factor_between(given, wanted)
    if factor is None:
        raise UsageError(f"{given or 'a number without unit'} cannot be given in {wanted or 'a number without unit'}")
    return value if factor == 1 else value * factor
