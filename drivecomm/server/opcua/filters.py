"""Data change filters of OPC UA: the changes of a value that a client receives (Part 4, 7.17.2; Part 8, 6.2).

A change of status is always sent. A deadband counts from the last sent value and ignores timestamps: with a deadband,
the trigger StatusValueTimestamp acts as StatusValue.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from asyncua import ua

# The class of filters received over a connection. `ua.DataChangeFilter` is a subclass for programs only.
from asyncua.ua.uaprotocol_auto import DataChangeFilter

from drivecomm.server.opcua.refusals import RefusedPartError

if TYPE_CHECKING:
    from collections.abc import Callable


@dataclass(frozen=True, slots=True)
class ChangeFilter:
    """Data change filter. deadband: least difference of a number from the last sent one; None for any change."""

    trigger: ua.DataChangeTrigger = ua.DataChangeTrigger.StatusValue
    deadband: float | None = None

    def passes(self, last: ua.DataValue | None, value: ua.DataValue) -> bool:
        """Return whether a value is sent. last: the last sent value, None if there is none."""
        if last is None or last.StatusCode != value.StatusCode:
            return True
        if self.trigger == ua.DataChangeTrigger.Status:
            return False
        before, now = (None if each.Value is None else each.Value.Value for each in (last, value))
        if self.deadband is not None:
            return _differ(before, now, self.deadband)
        if self.trigger == ua.DataChangeTrigger.StatusValueTimestamp and last.SourceTimestamp != value.SourceTimestamp:
            return True
        return not _same(before, now)


def change_filter(
    wished: object, attribute: int, *, is_numeric: bool, span: Callable[[], float | None]
) -> ChangeFilter:
    """Return the requested filter for an attribute of a node. Raises RefusedPartError.

    is_numeric: whether its values are numbers. span: returns the width of the engineering unit range, to which a
    deadband in per cent refers; None without a range.
    """
    if wished is None or (isinstance(wished, ua.ExtensionObject) and not wished.Body):
        return ChangeFilter()
    if not isinstance(wished, DataChangeFilter):
        raise RefusedPartError(ua.StatusCodes.BadMonitoredItemFilterUnsupported)
    try:
        trigger, kind = ua.DataChangeTrigger(wished.Trigger), ua.DeadbandType(wished.DeadbandType)
    except ValueError:
        raise RefusedPartError(ua.StatusCodes.BadMonitoredItemFilterInvalid) from None
    if attribute != ua.AttributeIds.Value:
        raise RefusedPartError(ua.StatusCodes.BadFilterNotAllowed)
    if kind == ua.DeadbandType.None_:
        return ChangeFilter(trigger)
    size = wished.DeadbandValue
    if not is_numeric:
        raise RefusedPartError(ua.StatusCodes.BadFilterNotAllowed)
    if kind == ua.DeadbandType.Percent:
        if not 0 <= size <= 100 or (reach := span()) is None:
            raise RefusedPartError(ua.StatusCodes.BadDeadbandFilterInvalid)
        return ChangeFilter(trigger, size / 100 * reach)
    if not 0 <= size < math.inf:
        raise RefusedPartError(ua.StatusCodes.BadDeadbandFilterInvalid)
    return ChangeFilter(trigger, size)


def _same(before: Any, now: Any) -> bool:
    """Return whether two values are equal; NaN counts as equal to NaN."""
    return bool(before == now) or (_is_nan(before) and _is_nan(now))


def _differ(before: Any, now: Any, deadband: float) -> bool:
    """Return whether a value, or an element of an array, has left the deadband."""
    if isinstance(before, list) and isinstance(now, list) and len(before) == len(now):
        return any(_differ(*both, deadband) for both in zip(before, now, strict=True))
    if isinstance(before, int | float) and isinstance(now, int | float) and not (_is_nan(before) or _is_nan(now)):
        return abs(now - before) > deadband
    return not _same(before, now)


def _is_nan(value: Any) -> bool:
    return isinstance(value, float) and math.isnan(value)
