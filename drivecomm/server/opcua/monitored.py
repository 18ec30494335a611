"""Monitored items of subscriptions, in place of asyncua's own.

asyncua's items have no public hook for another filter. They lose values that go bad within a deadband, never send slow
drifts, and send every value if the deadband is in per cent. Its subscriptions call these by public names.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from asyncua import ua

from drivecomm.server.opcua import limits
from drivecomm.server.opcua.event_filters import EventFilter
from drivecomm.server.opcua.filters import ChangeFilter, change_filter
from drivecomm.server.opcua.refusals import RefusedPartError
from drivecomm.server.opcua.values import status

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from asyncua.server.address_space import AddressSpace
    from asyncua.server.internal_subscription import InternalSubscription

    from drivecomm.server.opcua.events import PlantEvent

_NO_NUMBERS = frozenset(
    ua.NodeId(ua.Int32(each), ua.Int16(0))
    for each in (ua.ObjectIds.String, ua.ObjectIds.Boolean, ua.ObjectIds.UtcTime, ua.ObjectIds.LocalizedText)
)
"""Data types of our variables that are not numeric."""
_FIRST = 112


@dataclass(slots=True)
class _Item:
    """Monitored item. filter: for values or for events. handle: handle of the callback for value changes."""

    number: int
    place: ua.ReadValueId
    client_handle: int
    mode: ua.MonitoringMode
    queue_size: int
    filter: ChangeFilter | EventFilter
    handle: int = 0
    last: ua.DataValue | None = None


class Items:
    """Items of one subscription."""

    def __init__(self, subscription: InternalSubscription, space: AddressSpace) -> None:
        self._subscription, self._space = subscription, space
        self._items: dict[int, _Item] = {}
        self._next = _FIRST

    @property
    def count(self) -> int:
        """Number of items."""
        return len(self._items)

    @property
    def event_count(self) -> int:
        """Number of items for events."""
        return sum(isinstance(each.filter, EventFilter) for each in self._items.values())

    def __contains__(self, number: int) -> bool:
        return number in self._items

    async def create(
        self, wanted: Sequence[ua.MonitoredItemCreateRequest], room: int, event_room: int
    ) -> list[ua.MonitoredItemCreateResult]:
        """Create items; each has its own result.

        room, event_room: how many more items, and more items for events, are permitted.
        """
        most, most_events = self.count + room, self.event_count + event_room
        results = []
        for each in wanted:
            is_event = each.ItemToMonitor.AttributeId == ua.AttributeIds.EventNotifier
            if self.count >= most or (is_event and self.event_count >= most_events):
                results.append(_refused(ua.StatusCodes.BadTooManyMonitoredItems))
                continue
            try:
                results.append(await self._create(each))
            except RefusedPartError as error:
                results.append(_refused(error.code))
        return results

    async def _create(self, wanted: ua.MonitoredItemCreateRequest) -> ua.MonitoredItemCreateResult:
        asked = wanted.RequestedParameters
        item = _Item(
            number=self._next, place=wanted.ItemToMonitor, client_handle=asked.ClientHandle, mode=wanted.MonitoringMode,
            queue_size=0, filter=self._filter(asked.Filter, wanted.ItemToMonitor),
        )  # fmt: skip
        item.queue_size = _queue_size(item, asked.QueueSize)
        if isinstance(item.filter, ChangeFilter):
            place = item.place
            found, item.handle = self._space.add_datachange_callback(
                place.NodeId, place.AttributeId, partial(self._changed, item)
            )
            if not found.is_good():
                raise RefusedPartError(found.value)
        self._items[item.number] = item
        self._next += 1
        await self._tell_current(item)
        return ua.MonitoredItemCreateResult(
            MonitoredItemId=ua.IntegerId(item.number),
            RevisedSamplingInterval=ua.Duration(self._subscription.data.RevisedPublishingInterval),
            RevisedQueueSize=ua.Counter(item.queue_size),
        )

    def modify_monitored_items(self, params: ua.ModifyMonitoredItemsParameters) -> list[ua.MonitoredItemModifyResult]:
        """Modify items; each has its own result."""
        return [self._modify(each) for each in params.ItemsToModify]

    def _modify(self, wanted: ua.MonitoredItemModifyRequest) -> ua.MonitoredItemModifyResult:
        item, asked = self._items.get(wanted.MonitoredItemId), wanted.RequestedParameters
        if item is None:
            return ua.MonitoredItemModifyResult(StatusCode=status(ua.StatusCodes.BadMonitoredItemIdInvalid))
        try:
            item.filter = self._filter(asked.Filter, item.place)
        except RefusedPartError as error:
            return ua.MonitoredItemModifyResult(StatusCode=status(error.code))
        item.client_handle = asked.ClientHandle
        item.queue_size = _queue_size(item, asked.QueueSize)
        return ua.MonitoredItemModifyResult(
            RevisedSamplingInterval=ua.Duration(self._subscription.data.RevisedPublishingInterval),
            RevisedQueueSize=ua.Counter(item.queue_size),
        )

    async def set_monitoring_mode(self, mode: ua.MonitoringMode, ids: Iterable[int]) -> list[ua.StatusCode]:
        """Enable or disable items; an item that starts to report sends its present value."""
        results = []
        for number in ids:
            item = self._items.get(number)
            if item is None:
                results.append(status(ua.StatusCodes.BadMonitoredItemIdInvalid))
                continue
            before, item.mode = item.mode, mode
            if mode == ua.MonitoringMode.Reporting != before:
                item.last = None
                await self._tell_current(item)
            results.append(ua.StatusCode())
        return results

    def delete_monitored_items(self, ids: Iterable[int]) -> list[ua.StatusCode]:
        """Delete items."""
        results = []
        for number in ids:
            item = self._items.pop(number, None)
            if item is not None and item.handle:
                self._space.delete_datachange_callback(item.handle)
            results.append(status(ua.StatusCodes.BadMonitoredItemIdInvalid) if item is None else ua.StatusCode())
        return results

    def delete_all_monitored_items(self) -> None:
        """Delete all items."""
        self.delete_monitored_items(list(self._items))

    async def trigger_statuschange(self, code: ua.StatusCode) -> None:
        """Notify the client that the subscription has ended."""
        await self._subscription.enqueue_statuschange(code)

    async def tell(self, event: PlantEvent, only: int | None = None) -> None:
        """Queue an event for the items whose filter it passes. only: number of the only item to consider."""
        for item in list(self._items.values()):
            if not isinstance(item.filter, EventFilter) or only not in (None, item.number):
                continue
            wanted = event.notifiers is None or (item.place.NodeId in event.notifiers and item.filter.passes(event))
            if wanted and item.mode == ua.MonitoringMode.Reporting:
                told = ua.EventFieldList(
                    ClientHandle=ua.IntegerId(item.client_handle), EventFields=item.filter.fields(event)
                )
                await self._subscription.enqueue_event(item.number, told, item.queue_size)

    async def _tell_current(self, item: _Item) -> None:
        if isinstance(item.filter, ChangeFilter):
            value = self._space.read_attribute_value(item.place.NodeId, item.place.AttributeId)
            await self._changed(item, item.handle, value)

    async def _changed(self, item: _Item, _handle: int, value: ua.DataValue) -> None:
        if item.mode == ua.MonitoringMode.Disabled or not isinstance(item.filter, ChangeFilter):
            return
        if item.filter.passes(item.last, value):
            item.last = value
            if item.mode == ua.MonitoringMode.Reporting:
                told = ua.MonitoredItemNotification(ClientHandle=ua.IntegerId(item.client_handle), Value=value)
                await self._subscription.enqueue_datachange_event(item.number, told, item.queue_size)

    def _filter(self, wished: object, item: ua.ReadValueId) -> ChangeFilter | EventFilter:
        node = item.NodeId
        if item.AttributeId == ua.AttributeIds.EventNotifier:
            told = self._space.read_attribute_value(node, ua.AttributeIds.EventNotifier)
            if told.StatusCode is not None and not told.StatusCode.is_good():
                raise RefusedPartError(told.StatusCode.value)
            if told.Value is None or not told.Value.Value & 1:
                raise RefusedPartError(ua.StatusCodes.BadNotSupported)
            return EventFilter(wished)
        return change_filter(wished, item.AttributeId, is_numeric=self._is_numeric(node), span=lambda: self._span(node))

    def _is_numeric(self, node: ua.NodeId) -> bool:
        """Return whether the values of a variable are, or may be, numbers."""
        told = self._space.read_attribute_value(node, ua.AttributeIds.DataType).Value
        return told is None or told.Value not in _NO_NUMBERS

    def _span(self, node: ua.NodeId) -> float | None:
        """Return the width of the engineering unit range of a variable, None without a range."""
        place = ua.NodeId(ua.String(f"{node.Identifier!s}/EURange"), node.NamespaceIndex)
        told = self._space.read_attribute_value(place, ua.AttributeIds.Value).Value
        reach = None if told is None else told.Value
        return float(reach.High - reach.Low) if isinstance(reach, ua.Range) else None


def _queue_size(item: _Item, wished: int) -> int:
    if isinstance(item.filter, EventFilter):
        return limits.QUEUED_EVENTS
    return min(wished or limits.QUEUED_VALUES, limits.QUEUED_VALUES)


def _refused(code: int) -> ua.MonitoredItemCreateResult:
    return ua.MonitoredItemCreateResult(StatusCode=status(code))
