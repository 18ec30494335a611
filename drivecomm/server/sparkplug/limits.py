"""Limits of a drive's quantities from its model, for the scales of host displays."""

from __future__ import annotations

from contextlib import suppress
from functools import lru_cache
from typing import TYPE_CHECKING

from drivecomm.errors import DriveCommError
from drivecomm.models import converted, load_model, parameter_at
from drivecomm.protocol import installed

if TYPE_CHECKING:
    from decimal import Decimal

    from drivecomm.protocol import DriveConfig, Model


def limits_of(drive: DriveConfig, name: str, unit: str) -> tuple[Decimal | None, Decimal | None]:
    """Return lowest and highest value of a parameter or common name in this unit, None for an unknown limit.

    Reads the model file at the first call.
    """
    with suppress(DriveCommError, OSError):
        model = _model(drive.protocol, str(drive.options.get("model") or ""))
        info = None if model is None else parameter_at(model.quantities.get(name, name), model)
        if info is not None:
            low, high = (
                None if each is None else converted(each, info.unit, unit) for each in (info.minimum, info.maximum)
            )
            return low, high
    return None, None


@lru_cache(maxsize=64)
def _model(protocol: str, name: str) -> Model | None:
    return load_model(installed[protocol].package, protocol, name) if name else None
