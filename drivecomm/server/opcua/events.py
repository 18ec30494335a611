"""Events of the plant as OPC UA events, notified by the server, the plant and the drive concerned."""

from __future__ import annotations

import uuid
from dataclasses import dataclass
from typing import TYPE_CHECKING

from asyncua import ua

from drivecomm.server.opcua.instances import with_supertypes
from drivecomm.server.opcua.nodes import standard
from drivecomm.server.opcua.values import NULL, moment, now

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.server import Event
    from drivecomm.server.opcua.nodes import Nodes
    from drivecomm.server.opcua.subscriptions import Subscriptions
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
_LOCAL_TIME = ua.Variant(ua.TimeZoneDataType(), ua.VariantType.ExtensionObject)


@dataclass(frozen=True, slots=True, kw_only=True)
class PlantEvent:
    """Event.

    fields: by browse names, with a slash between those of a path. types: its type and supertypes. notifiers: nodes that
    notify it; None if it goes to every item, whatever its filter. condition: condition of the event, None without one.
    """

    fields: Mapping[str, ua.Variant]
    types: frozenset[ua.NodeId]
    notifiers: frozenset[ua.NodeId] | None
    condition: ua.NodeId | None = None

    def field(self, path: str, attribute: int) -> ua.Variant:
        """Return a field, null if the event does not have it; for an empty path, the id of its condition."""
        if path:
            return self.fields.get(path, NULL)
        is_condition = self.condition is not None and attribute == ua.AttributeIds.NodeId
        return ua.Variant(self.condition, ua.VariantType.NodeId) if is_condition else NULL


def base_fields(  # noqa: PLR0917 - what all events have
    kind: ua.NodeId, source: ua.NodeId, name: str, text: str, severity: int, time_s: float
) -> dict[str, ua.Variant]:
    """Return the fields that every event has. kind: its type. source, name: node and name of its source."""
    return {
        "EventId": ua.Variant(uuid.uuid4().bytes, ua.VariantType.ByteString),
        "EventType": ua.Variant(kind, ua.VariantType.NodeId),
        "SourceNode": ua.Variant(source, ua.VariantType.NodeId),
        "SourceName": ua.Variant(name, ua.VariantType.String),
        "Time": ua.Variant(moment(time_s), ua.VariantType.DateTime),
        "ReceiveTime": ua.Variant(now(), ua.VariantType.DateTime),
        "LocalTime": _LOCAL_TIME,
        "Message": ua.Variant(ua.LocalizedText(text), ua.VariantType.LocalizedText),
        "Severity": ua.Variant(severity, ua.VariantType.UInt16),
    }


class Events:
    """Sender of events to subscriptions. kind: type of events without a condition."""

    def __init__(self, tree: PlantTree, nodes: Nodes, subscriptions: Subscriptions, kind: ua.NodeId) -> None:
        self._tree, self._subscriptions, self._kind = tree, subscriptions, kind
        self._types = with_supertypes(nodes, kind)

    def notifiers(self, drive: str) -> frozenset[ua.NodeId]:
        """Return the nodes that notify an event of a drive; for an event without a drive, those of the plant."""
        node = self._tree.node_of(drive) if drive else None
        return frozenset({standard(ua.ObjectIds.Server), self._tree.root, node or self._tree.root})

    async def tell_happened(self, happened: Event) -> None:
        """Send an event of the plant."""
        source = (self._tree.node_of(happened.drive) if happened.drive else None) or self._tree.root
        fields = base_fields(
            self._kind, source, happened.drive or happened.line or "plant", happened.text,
            _SEVERITIES.get(happened.kind, _OTHERS), happened.time_s,
        )  # fmt: skip
        for name, text in (
            ("Kind", happened.kind), ("Drive", happened.drive), ("Line", happened.line), ("Who", happened.who),
        ):  # fmt: skip
            fields[name] = ua.Variant(text, ua.VariantType.String)
        await self.tell(PlantEvent(fields=fields, types=self._types, notifiers=self.notifiers(happened.drive)))

    async def tell(self, event: PlantEvent) -> None:
        """Send an event to all subscriptions."""
        for _, items in self._subscriptions.listening():
            await items.tell(event)
