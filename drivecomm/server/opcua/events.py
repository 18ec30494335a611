"""What happens in the plant, as OPC UA events: of the server, of the plant, and of the drive that it is about."""

from __future__ import annotations

import uuid
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from asyncua import ua
from asyncua.common.event_objects import BaseEvent

from drivecomm.server.opcua.nodes import standard
from drivecomm.server.opcua.values import moment

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from asyncua.server.subscription_service import SubscriptionService

    from drivecomm.server import Event
    from drivecomm.server.opcua.tree import PlantTree

_SEVERITIES: Mapping[str, int] = {
    "fault": 900,
    "alarm": 800,
    "silent": 700,
    "link loss": 700,
    "line": 700,
    "warning": 500,
    "door": 300,
    "fault over": 200,
    "answers": 200,
    "lease": 100,
    "command": 100,
    "state": 100,
    "server": 100,
}
_OTHERS = 100
_ABOVE = (ua.ObjectIds.SystemEventType, ua.ObjectIds.BaseEventType)


class PlantEvent(BaseEvent):
    """One event. types: its own type, and those that it is a kind of."""

    def __init__(self, event: Event, kind: ua.NodeId, source: ua.NodeId) -> None:
        super().__init__(message=event.text, severity=_SEVERITIES.get(event.kind, _OTHERS))  # type: ignore[no-untyped-call]
        self.types = frozenset({kind, *map(standard, _ABOVE)})
        self.EventId = uuid.uuid4().hex.encode()
        self.EventType = kind
        self.SourceNode = source
        self.SourceName = event.drive or event.line or "plant"
        self.Time = moment(event.time_s)
        self.ReceiveTime = datetime.now(UTC)
        self.LocalTime = ua.TimeZoneDataType()
        for name, text in (("Kind", event.kind), ("Drive", event.drive), ("Line", event.line), ("Who", event.who)):
            self.add_property(name, text, ua.VariantType.String)

    def to_event_fields(self, select_clauses: Sequence[ua.SimpleAttributeOperand]) -> list[ua.Variant]:
        """Return the fields that a client has asked for; one that an event does not have is null."""
        return [self._field(each) for each in select_clauses or ()]

    def _field(self, wanted: ua.SimpleAttributeOperand) -> ua.Variant:
        path = wanted.BrowsePath or []
        name = "/".join(str(each.Name) for each in path)
        if name not in self.data_types:
            return ua.Variant(None)
        value = getattr(self, name)
        return ua.Variant(None) if value is None else ua.Variant(value, self.data_types[name])


class Events:
    """Tells events to those who listen. kind: their type."""

    def __init__(self, tree: PlantTree, subscriptions: SubscriptionService, kind: ua.NodeId) -> None:
        self._tree, self._subscriptions, self._kind = tree, subscriptions, kind

    async def tell(self, happened: Event) -> None:
        """Tell an event."""
        drive = self._tree.node_of(happened.drive) if happened.drive else None
        event = PlantEvent(happened, self._kind, drive or self._tree.root)
        for node in (standard(ua.ObjectIds.Server), self._tree.root, drive):
            if node is not None:
                event.emitting_node = node
                for each in list(self._subscriptions.subscriptions.values()):
                    await each.monitored_item_srv.trigger_event(event)
