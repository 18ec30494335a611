"""Unit, type and limits of a polled value, known from common names and models before the first reading."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from asyncua import ua

from drivecomm.errors import DriveCommError
from drivecomm.models import TEXT_QUANTITIES, converted, is_monitoring_only, parameter_at, quantities
from drivecomm.plant import model_of
from drivecomm.protocol import installed

if TYPE_CHECKING:
    from decimal import Decimal

    from drivecomm.protocol import DriveConfig, Model, ParameterInfo

_TEXT_TYPES = frozenset({"string", "text"})


@dataclass(frozen=True, slots=True, kw_only=True)
class Facts:
    """Properties of a value. kind: its type, None for any. limits: lowest and highest value, None if unknown."""

    unit: str = ""
    kind: ua.VariantType | None = None
    limits: tuple[float, float] | None = None
    about: str = ""


def monitoring_only(config: DriveConfig) -> bool:
    """Return whether a drive is monitoring only; False if its model cannot be read."""
    model = model_of(config)
    return model is not None and is_monitoring_only(installed[config.protocol], model)


def facts_of(name: str, model: Model | None) -> Facts:
    """Return the properties of a polled value."""
    quantity = quantities().get(name)
    if quantity is None:
        info = None if model is None else parameter_at(name, model)
        return Facts() if info is None else _of_parameter(info)
    about = f"{quantity.meaning[0].upper()}{quantity.meaning[1:]}."
    if name in TEXT_QUANTITIES:
        return Facts(kind=ua.VariantType.String, about=about)
    address = None if model is None else model.quantities.get(name)
    info = None if model is None or address is None else parameter_at(address, model)
    limits = None if info is None else _limits(info, quantity.unit)
    return Facts(unit=quantity.unit, kind=ua.VariantType.Double, limits=limits, about=about)


def _of_parameter(info: ParameterInfo) -> Facts:
    if info.type in _TEXT_TYPES:
        return Facts(kind=ua.VariantType.String, about=info.title)
    kind = ua.VariantType.Double if info.type else None
    return Facts(unit=info.unit, kind=kind, limits=_limits(info, info.unit), about=info.title)


def _limits(info: ParameterInfo, unit: str) -> tuple[float, float] | None:
    if info.minimum is None or info.maximum is None:
        return None
    try:
        return _number(info.minimum, info.unit, unit), _number(info.maximum, info.unit, unit)
    except DriveCommError:
        return None


def _number(value: Decimal, given: str, wanted: str) -> float:
    return float(converted(value, given, wanted))
