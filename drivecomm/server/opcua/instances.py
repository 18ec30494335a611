"""Instances of standard types: supertypes of a type, and the variables that a type declares."""

from __future__ import annotations

from typing import TYPE_CHECKING

from asyncua import ua

from drivecomm.server.opcua.nodes import COMPONENT, PROPERTY, SUBTYPE
from drivecomm.server.opcua.values import waiting

if TYPE_CHECKING:
    from drivecomm.server.opcua.nodes import Nodes


def with_supertypes(nodes: Nodes, kind: ua.NodeId) -> frozenset[ua.NodeId]:
    """Return a type and all its supertypes."""
    found, above = {kind}, [kind]
    while above:
        references = nodes.references(above.pop())
        above = [each.NodeId for each in references if each.ReferenceTypeId == SUBTYPE and not each.IsForward]
        found.update(above)
    return frozenset(found)


def make_variable(nodes: Nodes, node: ua.NodeId, kind: ua.NodeId, path: str) -> ua.NodeId:
    """Create a variable of an instance and the objects on its path.

    kind: type of the instance. path: browse names, separated by slashes.
    """
    declared = next(
        found for each in with_supertypes(nodes, kind) if (found := _declared(nodes, each, path.split("/"))) is not None
    )
    parent = node
    for each in declared:
        name = str(each.BrowseName.Name)
        below = nodes.id(str(parent.Identifier), name)
        if each.NodeClass == ua.NodeClass.Object:
            nodes.make_object(parent, below, each.BrowseName, kind=each.TypeDefinition, by=each.ReferenceTypeId)
        else:
            data_type = nodes.data_type(each.NodeId)
            assert data_type is not None  # noqa: S101 - every variable has one
            nodes.variable(
                parent, below, each.BrowseName, waiting(), data_type, kind=each.TypeDefinition, by=each.ReferenceTypeId
            )
        parent = below
    return parent


def _declared(nodes: Nodes, node: ua.NodeId, path: list[str]) -> list[ua.ReferenceDescription] | None:
    """Return the references along a path in a declaration, None if the path is not declared."""
    if not path:
        return []
    for each in nodes.references(node):
        if each.IsForward and each.ReferenceTypeId in (COMPONENT, PROPERTY) and each.BrowseName.Name == path[0]:
            below = _declared(nodes, each.NodeId, path[1:])
            return None if below is None else [each, *below]
    return None
