"""Event filters of OPC UA: the events and fields that a client receives (Part 4, 7.17.3 and 7.4)."""

from __future__ import annotations

import operator
from typing import TYPE_CHECKING, Any

from asyncua import ua

from drivecomm.server.opcua import limits
from drivecomm.server.opcua.refusals import RefusedPartError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from drivecomm.server.opcua.events import PlantEvent


def _not(value: object) -> object:
    return None if value is None else not value


_OPERATORS: Mapping[ua.FilterOperator, Callable[..., Any]] = {
    ua.FilterOperator.Equals: operator.eq,
    ua.FilterOperator.IsNull: lambda value: value is None,
    ua.FilterOperator.GreaterThan: operator.gt,
    ua.FilterOperator.LessThan: operator.lt,
    ua.FilterOperator.GreaterThanOrEqual: operator.ge,
    ua.FilterOperator.LessThanOrEqual: operator.le,
    ua.FilterOperator.Not: _not,
    ua.FilterOperator.Between: lambda value, low, high: low <= value <= high,
    ua.FilterOperator.InList: lambda value, *listed: value in listed,
    ua.FilterOperator.And: lambda one, other: one and other,
    ua.FilterOperator.Or: lambda one, other: one or other,
}


class EventFilter:
    """Event filter of one client. Raises RefusedPartError for another kind of filter, or for an invalid one."""

    def __init__(self, wished: object) -> None:
        if not isinstance(wished, ua.EventFilter):
            raise RefusedPartError(ua.StatusCodes.BadEventFilterInvalid)
        self._selected = wished.SelectClauses or []
        self._elements = wished.WhereClause.Elements or []
        if len(self._selected) > limits.FILTER_FIELDS or len(self._elements) > limits.FILTER_ELEMENTS:
            raise RefusedPartError(ua.StatusCodes.BadEventFilterInvalid)
        for place, element in enumerate(self._elements):
            if element.FilterOperator not in _OPERATORS and element.FilterOperator != ua.FilterOperator.OfType:
                raise RefusedPartError(ua.StatusCodes.BadFilterOperatorUnsupported)
            for each in element.FilterOperands or []:
                # References to later elements only, so that the evaluation terminates.
                if isinstance(each, ua.ElementOperand) and not place < each.Index < len(self._elements):
                    raise RefusedPartError(ua.StatusCodes.BadEventFilterInvalid)

    def fields(self, event: PlantEvent) -> list[ua.Variant]:
        """Return the selected fields of an event; null for a field that the event does not have."""
        return [event.field(_names(each.BrowsePath), each.AttributeId) for each in self._selected]

    def passes(self, event: PlantEvent) -> bool:
        """Return whether the client receives an event; False if the filter cannot be evaluated."""
        found: dict[int, Any] = {}
        # Backwards, so that each element is evaluated once, however many others refer to it.
        for place, element in reversed(list(enumerate(self._elements))):
            try:
                given = [_value(each, event, found) for each in element.FilterOperands or []]
                if element.FilterOperator == ua.FilterOperator.OfType:
                    found[place] = given[0] in event.types
                else:
                    found[place] = _OPERATORS[element.FilterOperator](*given)
            except Exception:  # noqa: BLE001 - a filter is whatever a client makes of it
                found[place] = None
        return not self._elements or bool(found[0])


def _value(operand: object, event: PlantEvent, found: Mapping[int, Any]) -> Any:
    if isinstance(operand, ua.ElementOperand):
        return found[operand.Index]
    if isinstance(operand, ua.LiteralOperand):
        return None if operand.Value is None else operand.Value.Value
    if isinstance(operand, ua.SimpleAttributeOperand):
        return event.field(_names(operand.BrowsePath), operand.AttributeId).Value
    return None


def _names(path: Sequence[ua.QualifiedName] | None) -> str:
    return "/".join(str(each.Name) for each in path or ())
