"""Nodes of an address space, built to use little memory: a plant has ten thousand of them.

Data common to many nodes (types, access, the reference to the folder) is one shared object. Clients cannot write
anything. A node that already exists stays, with its value and its monitored items.
"""

from __future__ import annotations

import logging
from functools import cache
from typing import TYPE_CHECKING, Any, TypeAlias

from asyncua import ua
from asyncua.server.address_space import AttributeValue, NodeData

from drivecomm.server.opcua.values import GOOD, status

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Collection, Iterator, Sequence

    from asyncua.server.address_space import AddressSpace

    Called: TypeAlias = Callable[..., Awaitable[Any]]

_log = logging.getLogger("drivecomm.server")

_READ, _READ_HISTORY = 1, 4
_NOWHERE = ua.NodeId()
_GONE = status(ua.StatusCodes.BadNodeIdUnknown)


@cache
def standard(identifier: int) -> ua.NodeId:
    """Return the id of a standard node, by its number in `ua.ObjectIds`."""
    return ua.NodeId(ua.Int32(identifier), ua.Int16(0))


COMPONENT, PROPERTY, ORGANIZES, NOTIFIER, SUBTYPE, GENERATES = (
    standard(each)
    for each in (
        ua.ObjectIds.HasComponent,
        ua.ObjectIds.HasProperty,
        ua.ObjectIds.Organizes,
        ua.ObjectIds.HasNotifier,
        ua.ObjectIds.HasSubtype,
        ua.ObjectIds.GeneratesEvent,
    )
)
FOLDER, OBJECT, VARIABLE, ANALOG, PROPERTY_TYPE = (
    standard(each)
    for each in (
        ua.ObjectIds.FolderType,
        ua.ObjectIds.BaseObjectType,
        ua.ObjectIds.BaseDataVariableType,
        ua.ObjectIds.AnalogUnitType,
        ua.ObjectIds.PropertyType,
    )
)


class Nodes:
    """Builder of nodes in one namespace of an address space. namespace: index of the namespace."""

    def __init__(self, space: AddressSpace, namespace: int) -> None:
        self._space = space
        self._namespace = ua.Int16(namespace)
        self._shared: dict[tuple[ua.AttributeIds, Any], AttributeValue] = {}
        self._back: dict[tuple[ua.NodeId, ua.NodeId], ua.ReferenceDescription] = {}
        self._to_shared: dict[tuple[ua.NodeId, ua.NodeId], ua.ReferenceDescription] = {}
        self.touched: set[ua.NodeId] = set()
        """Nodes created or found to exist since this set was last cleared."""

    def id(self, *parts: str) -> ua.NodeId:
        """Return a node id in our namespace."""
        return ua.NodeId(ua.String("/".join(parts)), self._namespace)

    def make_object(
        self,
        parent: ua.NodeId,
        node: ua.NodeId,
        name: str | ua.QualifiedName,
        *,
        kind: ua.NodeId = OBJECT,
        by: ua.NodeId = COMPONENT,
        about: str = "",
        notifies: bool = False,
    ) -> ua.NodeId:
        """Create an object. notifies: whether clients can subscribe to events of it."""
        data = self._node(parent, node, name, ua.NodeClass.Object, kind, by, about)
        if data is not None:
            self._give(data, ua.AttributeIds.EventNotifier, int(notifies), ua.VariantType.Byte)
        return node

    def object_type(self, parent: ua.NodeId, node: ua.NodeId, name: str, about: str) -> ua.NodeId:
        """Create a type of objects or events below another one."""
        data = self._node(parent, node, name, ua.NodeClass.ObjectType, None, SUBTYPE, about)
        if data is not None:
            self._give(data, ua.AttributeIds.IsAbstract, False, ua.VariantType.Boolean)
        return node

    def variable(
        self,
        parent: ua.NodeId,
        node: ua.NodeId,
        name: str | ua.QualifiedName,
        value: ua.DataValue,
        data_type: int | ua.NodeId,
        *,
        kind: ua.NodeId = VARIABLE,
        by: ua.NodeId = COMPONENT,
        about: str = "",
        rank: int = ua.ValueRank.Scalar,
        history: bool = False,
    ) -> ua.NodeId:
        """Create a variable. data_type: id or number in `ua.ObjectIds`. history: whether its history can be read."""
        data = self._node(parent, node, name, ua.NodeClass.Variable, kind, by, about)
        if data is not None:
            access = _READ | (_READ_HISTORY if history else 0)
            data.attributes[ua.AttributeIds.Value] = AttributeValue(value)
            type_id = data_type if isinstance(data_type, ua.NodeId) else standard(data_type)
            self._give(data, ua.AttributeIds.DataType, type_id, ua.VariantType.NodeId)
            self._give(data, ua.AttributeIds.ValueRank, int(rank), ua.VariantType.Int32)
            self._give(data, ua.AttributeIds.AccessLevel, access, ua.VariantType.Byte)
            self._give(data, ua.AttributeIds.UserAccessLevel, access, ua.VariantType.Byte)
            self._give(data, ua.AttributeIds.MinimumSamplingInterval, 0.0, ua.VariantType.Double)
            self._give(data, ua.AttributeIds.Historizing, history, ua.VariantType.Boolean)
        return node

    def display(self, node: ua.NodeId, name: str) -> None:
        """Set a display name that differs from the browse name."""
        attribute, kind = ua.AttributeIds.DisplayName, ua.VariantType.LocalizedText
        self._give(self._space[node], attribute, ua.LocalizedText(name), kind, name)

    def property(
        self, parent: ua.NodeId, node: ua.NodeId, name: str, value: ua.Variant, data_type: int, *, rank: int = -1
    ) -> ua.NodeId:
        """Create a property with a standard name."""
        told = ua.DataValue(value, GOOD)
        qualified = ua.QualifiedName(name, 0)
        return self.variable(parent, node, qualified, told, data_type, kind=PROPERTY_TYPE, by=PROPERTY, rank=rank)

    def method(  # noqa: PLR0917 - what a method is
        self,
        parent: ua.NodeId,
        node: ua.NodeId,
        name: str,
        call: Called,
        takes: list[ua.Argument],
        gives: list[ua.Argument],
        about: str,
    ) -> ua.NodeId:
        """Create a method. call: receives the id of the object on which it is called, and the arguments."""
        data = self._node(parent, node, name, ua.NodeClass.Method, None, COMPONENT, about)
        if data is not None:
            self._give(data, ua.AttributeIds.Executable, True, ua.VariantType.Boolean)
            self._give(data, ua.AttributeIds.UserExecutable, True, ua.VariantType.Boolean)
            data.call = call
            for word, arguments in (("InputArguments", takes), ("OutputArguments", gives)):
                if arguments:
                    below = self.id(str(node.Identifier), word)
                    told = ua.Variant(arguments, ua.VariantType.ExtensionObject, is_array=True)
                    self.property(node, below, word, told, ua.ObjectIds.Argument, rank=ua.ValueRank.OneDimension)
        return node

    def refer(self, source: ua.NodeId, target: ua.NodeId, by: ua.NodeId) -> None:
        """Add a reference unless it exists."""
        references = self._space[source].references
        if not any(each.NodeId == target and each.ReferenceTypeId == by for each in references):
            # One shared object for all equal references.
            key = target, by
            if key not in self._to_shared:
                self._to_shared[key] = self._forward(self._space[target], by)
            references.append(self._to_shared[key])

    def refer_no_more(self, source: ua.NodeId, targets: Collection[ua.NodeId]) -> None:
        """Remove the references from a node to these targets."""
        data = self._space[source]
        data.references = [each for each in data.references if not (each.IsForward and each.NodeId in targets)]

    def references(self, node: ua.NodeId) -> Sequence[ua.ReferenceDescription]:
        """Return the references of a node, in both directions."""
        return self._space[node].references

    def below(self, node: ua.NodeId) -> Iterator[ua.NodeId]:
        """Yield a node and all nodes below it."""
        yield node
        for each in self._space[node].references:
            if each.IsForward and each.NodeId.NamespaceIndex == self._namespace and self._is_below(each.NodeId, node):
                yield from self.below(each.NodeId)

    async def remove(self, nodes: Collection[ua.NodeId]) -> None:
        """Remove nodes and notify their monitored items."""
        gone = set(nodes)
        for node in gone:
            data = self._space.get(node)
            if data is None:
                continue
            for reference in data.references:
                if not reference.IsForward and reference.NodeId not in gone and reference.NodeId in self._space:
                    self.refer_no_more(reference.NodeId, {node})
            value = data.attributes.get(ua.AttributeIds.Value)
            if value is not None:
                await self._tell(value, ua.DataValue(ua.Variant(None, ua.VariantType.Null), _GONE))
                for handle in list(value.datachange_callbacks):
                    self._space.delete_datachange_callback(handle)
            del self._space[node]

    def make_when_read(self, node: ua.NodeId, make: Callable[[], ua.DataValue]) -> AttributeValue:
        """Compute the value of a variable on demand; return its attribute, for `changed`.

        Most values of a plant are polled far more often than clients read them.
        """
        attribute = self._space[node].attributes[ua.AttributeIds.Value]
        attribute.value_callback = lambda *_: make()
        return attribute

    async def changed(self, attribute: AttributeValue) -> None:
        """Notify the monitored items of a value that is computed on demand."""
        if attribute.datachange_callbacks and attribute.value_callback is not None:
            await self._tell(attribute, attribute.value_callback(_NOWHERE, ua.AttributeIds.Value))

    def data_type(self, node: ua.NodeId) -> ua.NodeId | None:
        """Return the data type of a variable, None if the node does not exist."""
        data = self._space.get(node)
        value = None if data is None else data.attributes[ua.AttributeIds.DataType].value
        return value.Value.Value if value is not None and value.Value is not None else None

    async def write(self, node: ua.NodeId, value: ua.DataValue) -> None:
        """Set the value of a variable and notify its monitored items. A missing node is ignored."""
        data = self._space.get(node)
        if data is not None:
            attribute = data.attributes[ua.AttributeIds.Value]
            attribute.value = value
            await self._tell(attribute, value)

    def notifies(self, node: ua.NodeId) -> None:
        """Make a standard node a notifier of events."""
        self._give(self._space[node], ua.AttributeIds.EventNotifier, 1, ua.VariantType.Byte)

    async def _tell(self, attribute: AttributeValue, value: ua.DataValue) -> None:
        for handle, callback in list(attribute.datachange_callbacks.items()):
            try:
                await callback(handle, value)
            except Exception:  # noqa: BLE001 - one who listens keeps nothing from the others
                _log.exception("telling a value")

    def _is_below(self, node: ua.NodeId, above: ua.NodeId) -> bool:
        return str(node.Identifier).startswith(f"{above.Identifier!s}/")

    def _node(  # noqa: PLR0917 - what all nodes have
        self,
        parent: ua.NodeId,
        node: ua.NodeId,
        name: str | ua.QualifiedName,
        node_class: ua.NodeClass,
        kind: ua.NodeId | None,
        by: ua.NodeId,
        about: str,
    ) -> NodeData | None:
        """Create a node with references from and to its parent. None if it already exists."""
        self.touched.add(node)
        if node in self._space:
            return None
        data = NodeData(node)
        qualified = name if isinstance(name, ua.QualifiedName) else ua.QualifiedName(name, self._namespace)
        data.attributes[ua.AttributeIds.NodeId] = AttributeValue(_value(node, ua.VariantType.NodeId))
        self._give(data, ua.AttributeIds.NodeClass, node_class, ua.VariantType.Int32)
        shown, said = qualified.Name, (qualified.NamespaceIndex, qualified.Name)
        self._give(data, ua.AttributeIds.BrowseName, qualified, ua.VariantType.QualifiedName, said)
        self._give(data, ua.AttributeIds.DisplayName, ua.LocalizedText(shown), ua.VariantType.LocalizedText, shown)
        if about:
            self._give(data, ua.AttributeIds.Description, ua.LocalizedText(about), ua.VariantType.LocalizedText, about)
        for attribute in (ua.AttributeIds.WriteMask, ua.AttributeIds.UserWriteMask):
            self._give(data, attribute, 0, ua.VariantType.UInt32)
        data.references.append(self._way_back(parent, by))
        if kind is not None:
            data.references.append(self._type(kind))
        self._space[node] = data
        self._space[parent].references.append(self._forward(data, by, kind))
        return data

    def _give(
        self, data: NodeData, attribute: ua.AttributeIds, value: Any, kind: ua.VariantType, known_as: object = None
    ) -> None:
        key = attribute, value if known_as is None else known_as
        shared = self._shared.get(key)
        if shared is None:
            shared = self._shared[key] = AttributeValue(_value(value, kind))
        data.attributes[attribute] = shared

    def _type(self, kind: ua.NodeId) -> ua.ReferenceDescription:
        by = standard(ua.ObjectIds.HasTypeDefinition)
        found = self._back.get((kind, by))
        if found is None:
            found = self._back[kind, by] = self._forward(self._space[kind], by)
        return found

    def _way_back(self, parent: ua.NodeId, by: ua.NodeId) -> ua.ReferenceDescription:
        found = self._back.get((parent, by))
        if found is None:
            found = self._back[parent, by] = self._forward(self._space[parent], by)
            found.IsForward = False
        return found

    def _forward(self, target: NodeData, by: ua.NodeId, kind: ua.NodeId | None = None) -> ua.ReferenceDescription:
        def told(attribute: ua.AttributeIds) -> Any:
            value = target.attributes[attribute].value
            return value.Value.Value if value is not None and value.Value is not None else None

        return ua.ReferenceDescription(
            ReferenceTypeId=by,
            IsForward=True,
            NodeId=target.nodeid,
            BrowseName=told(ua.AttributeIds.BrowseName),
            DisplayName=told(ua.AttributeIds.DisplayName),
            NodeClass=told(ua.AttributeIds.NodeClass),
            TypeDefinition=kind or ua.NodeId(),
        )


def _value(value: Any, kind: ua.VariantType) -> ua.DataValue:
    return ua.DataValue(ua.Variant(value, kind), GOOD)
