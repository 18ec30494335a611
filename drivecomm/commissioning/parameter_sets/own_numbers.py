"""Values whose scale depends on more than the model, on their way back to the drive that told them.

How an inverter counts its currents depends on its rating, which somebody states with the drive. With another statement,
or none, than at the backup a physical value would be refused, or would be another number and a motor protected at the
wrong current. The same number says the same to the drive that told it, whatever it counts.
"""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping
    from typing import Any

    from drivecomm.commissioning.parameter_sets.parameter_set import Entry
    from drivecomm.commissioning.parameter_sets.restore_plan import Planned
    from drivecomm.protocol import Reading, Value


def number_told(entry: Entry) -> int | None:
    """Return the number that a value was told as; None where it says no more, or where somebody changed the value.

    The scales in question are powers of ten: a value with other digits than its number was written by hand, and counts.
    """
    if not isinstance(entry.raw, int) or entry.raw <= 0 or isinstance(entry.value, str):
        return None
    return entry.raw if _scale(entry.value, entry.raw) is not None else None


def same_scale(item: Planned, reading: Reading) -> bool:
    """Whether the drive counts now as it did when the value of this item was told; not where nothing shows it."""
    if reading.unit != item.unit or item.told is None or isinstance(item.value, str):
        return False
    if isinstance(reading.raw, str) or isinstance(reading.value, str):
        return False
    now = _scale(reading.value, reading.raw)
    return now is not None and now == _scale(item.value, item.told)


def as_told(item: Planned, options: Mapping[str, Any]) -> Planned:
    """Return the item with the number that was told in place of the value; options: those of writing such a one."""
    if item.told is None:
        return item
    return replace(item, value=item.told, unit="", options=dict(options), told=None)


def _scale(value: Value, raw: int) -> int | None:
    """Return the power of ten that one step counts; None for another scale, and for 0, which shows none."""
    if not raw or isinstance(value, str):
        return None
    sign, digits, exponent = (Decimal(value) / raw).normalize().as_tuple()
    return exponent if (sign, digits) == (0, (1,)) and isinstance(exponent, int) else None
