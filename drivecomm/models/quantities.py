"""Common names: quantities that drives of every maker have, each with its definition and its unit.

The registry is `quantities.toml` beside this module. A model says under `[quantities]` which of its parameters each is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from decimal import Decimal
from functools import cache
from typing import TYPE_CHECKING

from drivecomm.errors import ParameterAddressError
from drivecomm.models.units import converted
from drivecomm.protocol import exact

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.protocol import Model, ParameterInfo, Reading, Value


@dataclass(frozen=True, slots=True)
class Quantity:
    """A common name. unit: of every reading of it, on every drive; empty for a number or a text without one."""

    name: str
    unit: str
    meaning: str


@cache
def quantities() -> Mapping[str, Quantity]:
    """Return all common names, in the order of the registry."""
    import tomllib  # noqa: PLC0415 - loaded with the first common name, not with drivecomm
    from importlib import resources  # noqa: PLC0415 - as above

    content = tomllib.loads(resources.files("drivecomm.models").joinpath("quantities.toml").read_text(encoding="utf-8"))
    return {name: Quantity(name, entry["unit"], entry["meaning"]) for name, entry in content.items()}


class CommonName:
    """A common name on the drives of one model: which parameter it is there, and in which unit that one is."""

    def __init__(self, name: str, model: Model) -> None:
        self.quantity = quantities()[name]
        self.address = model.quantities[name]
        info = parameter_at(self.address, model)
        self._unit = info.unit if info else ""

    def told(self, reading: Reading) -> Reading:
        """Return a reading of the parameter as one of the quantity: under its name, in its unit."""
        told = replace(reading, name=self.quantity.name)
        if reading.unit == self.quantity.unit or isinstance(reading.value, str):
            return told
        value = converted(Decimal(reading.value), reading.unit, self.quantity.unit)
        return replace(told, value=value, unit=self.quantity.unit)

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
