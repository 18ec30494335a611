"""Values whose scale depends on more than the model, when they are restored to the drive that reported them.

The scale of an inverter's currents depends on its rating, which the user states with the drive. If that statement is
missing, or was another one at the backup, a physical value would be refused, or would become another number and protect
the motor at the wrong current. The raw number always means the same to the drive that reported it.
"""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping
    from typing import Any

    from drivecomm.commissioning.parameter_sets.parameter_set import ParameterEntry
    from drivecomm.commissioning.parameter_sets.restore_plan import PlannedItem
    from drivecomm.protocol import Reading, Value


def raw_number(entry: ParameterEntry) -> int | None:
    """Return the raw number of a value; None if it adds nothing to the value, or if the value was edited by hand.

    The possible scales are powers of ten: a value with other digits than its raw number was edited, and takes
    precedence.
    """
    if not isinstance(entry.raw, int) or entry.raw <= 0 or isinstance(entry.value, str):
        return None
    return entry.raw if _scale(entry.value, entry.raw) is not None else None


def same_scale(item: PlannedItem, reading: Reading) -> bool:
    """Return whether the drive uses the same scale now as at the backup of this item; False if that is unknown."""
    if reading.unit != item.unit or item.told is None or isinstance(item.value, str):
        return False
    if isinstance(reading.raw, str) or isinstance(reading.value, str):
        return False
    now = _scale(reading.value, reading.raw)
    return now is not None and now == _scale(item.value, item.told)


def as_raw_number(item: PlannedItem, options: Mapping[str, Any]) -> PlannedItem:
    """Return the item with its raw number instead of its value. options: options for writing a raw number."""
    if item.told is None:
        return item
    return replace(item, value=item.told, unit="", options=dict(options), told=None)


def _scale(value: Value, raw: int) -> int | None:
    """Return the scale of a raw number as an exponent of ten; None for any other scale and for raw 0."""
    if not raw or isinstance(value, str):
        return None
    sign, digits, exponent = (Decimal(value) / raw).normalize().as_tuple()
    return exponent if (sign, digits) == (0, (1,)) and isinstance(exponent, int) else None
