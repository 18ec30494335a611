"""Readings as quantities of the library pint, for who computes with units."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.errors import UsageError

if TYPE_CHECKING:
    from drivecomm.protocol.reading import Reading

# What the units of models are called there; the others have the same name.
_NAMES = {"%": "percent", "deg C": "degC", "1/min": "rpm", "": "dimensionless", "Nm": "N*m"}


def pint_quantity(reading: Reading, registry: Any = None) -> Any:
    """Return a reading's value with its unit. Raises UsageError."""
    try:
        import pint  # noqa: PLC0415 - optional
    except ImportError:
        raise UsageError("pint is not installed; install it with: pip install drivecomm[pint]") from None
    if isinstance(reading.value, str):
        raise UsageError(f"{reading.parameter} is the text {reading.value!r}; only numbers have a unit")
    registry = registry or pint.application_registry
    try:
        unit = registry.Unit(_NAMES.get(reading.unit, reading.unit))
    except (pint.errors.UndefinedUnitError, pint.errors.DefinitionSyntaxError) as error:
        raise UsageError(f"{reading.parameter} is in {reading.unit!r}, which is no physical unit: {error}") from error
    return registry.Quantity(reading.value, unit)
