"""What a subscription listens to, in place of asyncua's own.

asyncua's own, with no public place to put another rule in, loses values that go bad behind a deadband, never tells of
those that creep, and tells everything where a deadband is in per cent.
"""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Any

from asyncua import ua
from asyncua.common.utils import ServiceError
from asyncua.server.monitored_item_service import MonitoredItemService, WhereClauseEvaluator

from drivecomm.server.opcua import limits
from drivecomm.server.opcua.filters import ChangeFilter, change_filter
from drivecomm.server.opcua.refusals import RefusedPartError

if TYPE_CHECKING:
    from asyncua.server.address_space import AddressSpace
    from asyncua.server.internal_subscription import InternalSubscription
    from asyncua.server.monitored_item_service import MonitoredItemData

_log = logging.getLogger("drivecomm.server")

_NO_NUMBERS = frozenset(
    ua.NodeId(ua.Int32(each), ua.Int16(0))
    for each in (ua.ObjectIds.String, ua.ObjectIds.Boolean, ua.ObjectIds.UtcTime, ua.ObjectIds.LocalizedText)
)
"""The types of variables here that hold no numbers."""


class Items(MonitoredItemService):
    """The items of one subscription."""

    def __init__(self, subscription: InternalSubscription, space: AddressSpace) -> None:
        super().__init__(subscription, space)
        self._last: dict[int, ua.DataValue] = {}
        self._event_items: set[int] = set()

    @property
    def count(self) -> int:
        """How many there are."""
        return len(self._monitored_items)

    @property
    def event_count(self) -> int:
        """How many of them are for events."""
        return len(self._event_items)

    async def datachange_callback(self, handle: int, value: ua.DataValue, error: ua.StatusCode | None = None) -> None:
        """Queue a value that is to be told."""
        number = self._monitored_datachange.get(handle)
        item = None if number is None else self._monitored_items.get(number)
        if number is None or item is None or error is not None or item.mode == ua.MonitoringMode.Disabled:
            return
        if not item.filter.passes(self._last.get(number), value):
            return
        self._last[number] = value
        if item.mode == ua.MonitoringMode.Reporting:
            told = ua.MonitoredItemNotification(ClientHandle=ua.IntegerId(item.client_handle or 0), Value=value)
            await self.isub.enqueue_datachange_event(number, told, item.queue_size)

    def modify_monitored_items(self, params: ua.ModifyMonitoredItemsParameters) -> list[ua.MonitoredItemModifyResult]:
        """Change items within the limits; asyncua takes any length of a queue here, and fails for unknown ones."""
        results = []
        for each in params.ItemsToModify:
            result = ua.MonitoredItemModifyResult()
            item = self._monitored_items.get(each.MonitoredItemId)
            wished = each.RequestedParameters
            if item is None or item.read_value_id is None:
                result.StatusCode = ua.StatusCode(ua.UInt32(ua.StatusCodes.BadMonitoredItemIdInvalid))
            elif each.MonitoredItemId in self._event_items:
                result.StatusCode = ua.StatusCode(ua.UInt32(ua.StatusCodes.BadMonitoredItemFilterUnsupported))
            else:
                try:
                    item.filter = self._filter(wished.Filter, item.read_value_id)
                except RefusedPartError as error:
                    result.StatusCode = ua.StatusCode(ua.UInt32(error.code))
                    results.append(result)
                    continue
                item.client_handle = wished.ClientHandle
                item.queue_size = self._revise_queue_size(wished.QueueSize)
                result.RevisedQueueSize = ua.Counter(item.queue_size)
                result.RevisedSamplingInterval = ua.Duration(self.isub.data.RevisedPublishingInterval)
            results.append(result)
        return results

    async def _create_data_change_monitored_item(
        self, params: ua.MonitoredItemCreateRequest
    ) -> ua.MonitoredItemCreateResult:
        asked = params.RequestedParameters
        try:
            # What asyncua keeps for the item is what `datachange_callback` asks then.
            asked.Filter = self._filter(asked.Filter, params.ItemToMonitor)
        except RefusedPartError as error:
            return ua.MonitoredItemCreateResult(StatusCode=ua.StatusCode(ua.UInt32(error.code)))
        return await super()._create_data_change_monitored_item(params)

    def _filter(self, wished: object, item: ua.ReadValueId) -> ChangeFilter:
        node = item.NodeId
        return change_filter(wished, item.AttributeId, is_numeric=self._is_numeric(node), span=lambda: self._span(node))

    def _is_numeric(self, node: ua.NodeId) -> bool:
        """Return whether the values of a variable are numbers, or may be."""
        told = self.aspace.read_attribute_value(node, ua.AttributeIds.DataType).Value
        return told is None or told.Value not in _NO_NUMBERS

    def _span(self, node: ua.NodeId) -> float | None:
        """Return how far the engineering unit range of a variable of ours reaches, None without one."""
        place = ua.NodeId(ua.String(f"{node.Identifier!s}/EURange"), node.NamespaceIndex)
        told = self.aspace.read_attribute_value(place, ua.AttributeIds.Value).Value
        reach = None if told is None else told.Value
        return float(reach.High - reach.Low) if isinstance(reach, ua.Range) else None

    def _create_events_monitored_item(self, params: ua.MonitoredItemCreateRequest) -> ua.MonitoredItemCreateResult:
        wished = params.RequestedParameters.Filter
        if not isinstance(wished, ua.EventFilter) or not _can_be_evaluated(wished):
            code = ua.UInt32(ua.StatusCodes.BadEventFilterInvalid)
            return ua.MonitoredItemCreateResult(StatusCode=ua.StatusCode(code))
        result = super()._create_events_monitored_item(params)
        item = self._monitored_items.get(result.MonitoredItemId)
        if item is not None:
            item.queue_size = limits.QUEUED_EVENTS
            result.RevisedQueueSize = ua.Counter(item.queue_size)
            item.where_clause_evaluator = Where(self.logger, self.aspace, wished.WhereClause)
            self._event_items.add(result.MonitoredItemId)
        return result

    async def _trigger_event(self, event: Any, mid: int) -> None:
        try:
            await super()._trigger_event(event, mid)
        except Exception:  # noqa: BLE001 - one who listens keeps nothing from the others
            _log.debug("an event that a client cannot be told", exc_info=True)

    def _delete_monitored_items(self, mid: int) -> ua.StatusCode:
        self._last.pop(mid, None)
        self._event_items.discard(mid)
        return super()._delete_monitored_items(mid)

    def _commit_monitored_item(self, result: ua.MonitoredItemCreateResult, mdata: MonitoredItemData) -> None:
        mdata.queue_size = result.RevisedQueueSize = self._revise_queue_size(mdata.queue_size)
        super()._commit_monitored_item(result, mdata)


class Where(WhereClauseEvaluator):
    """Whether a client wants an event; a type that it names stands for those below it, too."""

    def eval(self, event: Any) -> bool:
        """Whether the event fits; what cannot be evaluated does not."""
        try:
            return not self.elements or bool(self._eval_el(0, event))
        except Exception:  # noqa: BLE001 - a filter is whatever a client makes of it
            return False

    def _eval_el(self, index: int, event: Any) -> Any:
        element = self.elements[index]
        if element.FilterOperator == ua.FilterOperator.OfType:
            return self._eval_op(element.FilterOperands[0], event) in event.types
        return super()._eval_el(index, event)


def check_room(wanted: int, there: int, most: int) -> None:
    """Raise ServiceError where so many more items are too many."""
    if there + wanted > most:
        raise ServiceError(ua.StatusCodes.BadTooManyMonitoredItems)


def _can_be_evaluated(wished: ua.EventFilter) -> bool:
    """Whether a filter of events is small, and its elements refer to later ones only, so that it comes to an end."""
    elements = wished.WhereClause.Elements or []
    return len(elements) <= limits.FILTER_ELEMENTS and all(
        not isinstance(operand, ua.ElementOperand) or operand.Index > place
        for place, element in enumerate(elements)
        for operand in element.FilterOperands or []
    )
