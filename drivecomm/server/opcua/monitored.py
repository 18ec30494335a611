"""What a subscription listens to, in place of asyncua's own.

A change of status is always told, whatever deadband a client wants, and a deadband counts from what was told last:
asyncua's own loses values that go bad, and never tells of those that creep.
"""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Any

from asyncua import ua
from asyncua.common.utils import ServiceError
from asyncua.server.monitored_item_service import MonitoredItemService, WhereClauseEvaluator

from drivecomm.server.opcua import limits

if TYPE_CHECKING:
    from asyncua.server.address_space import AddressSpace
    from asyncua.server.internal_subscription import InternalSubscription
    from asyncua.server.monitored_item_service import MonitoredItemData

_log = logging.getLogger("drivecomm.server")


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
        if not _is_news(self._last.get(number), value, item.filter):
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
            if item is None:
                result.StatusCode = ua.StatusCode(ua.UInt32(ua.StatusCodes.BadMonitoredItemIdInvalid))
            elif each.MonitoredItemId in self._event_items or not _can_be(wished.Filter):
                result.StatusCode = ua.StatusCode(ua.UInt32(ua.StatusCodes.BadMonitoredItemFilterUnsupported))
            else:
                item.filter = wished.Filter
                item.client_handle = wished.ClientHandle
                item.queue_size = self._revise_queue_size(wished.QueueSize)
                result.RevisedQueueSize = ua.Counter(item.queue_size)
                result.RevisedSamplingInterval = ua.Duration(self.isub.data.RevisedPublishingInterval)
            results.append(result)
        return results

    async def _create_data_change_monitored_item(
        self, params: ua.MonitoredItemCreateRequest
    ) -> ua.MonitoredItemCreateResult:
        if not _can_be(params.RequestedParameters.Filter):
            code = ua.StatusCodes.BadMonitoredItemFilterUnsupported
            return ua.MonitoredItemCreateResult(StatusCode=ua.StatusCode(ua.UInt32(code)))
        return await super()._create_data_change_monitored_item(params)

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


def _can_be(wished: object) -> bool:
    """Whether a filter of values is one that is kept to."""
    if wished is None or (isinstance(wished, ua.ExtensionObject) and not wished.Body):
        return True
    return isinstance(wished, ua.DataChangeFilter) and wished.DeadbandType in (
        ua.DeadbandType.None_,
        ua.DeadbandType.Absolute,
    )


def _can_be_evaluated(wished: ua.EventFilter) -> bool:
    """Whether a filter of events is small, and its elements refer to later ones only, so that it comes to an end."""
    elements = wished.WhereClause.Elements or []
    return len(elements) <= limits.FILTER_ELEMENTS and all(
        not isinstance(operand, ua.ElementOperand) or operand.Index > place
        for place, element in enumerate(elements)
        for operand in element.FilterOperands or []
    )


def _is_news(last: ua.DataValue | None, value: ua.DataValue, wished: Any) -> bool:
    if last is None or last.StatusCode != value.StatusCode:
        return True
    by_filter = isinstance(wished, ua.DataChangeFilter)
    trigger = wished.Trigger if by_filter else ua.DataChangeTrigger.StatusValue
    if trigger == ua.DataChangeTrigger.StatusValueTimestamp and last.SourceTimestamp != value.SourceTimestamp:
        return True
    if trigger == ua.DataChangeTrigger.Status or last.Value == value.Value:
        return False
    if by_filter and wished.DeadbandType == ua.DeadbandType.Absolute:
        before, now = (each.Value.Value if each.Value is not None else None for each in (last, value))
        if isinstance(before, int | float) and isinstance(now, int | float):
            return bool(abs(now - before) > wished.DeadbandValue)
    return True
