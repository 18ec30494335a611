"""State variables of drives and lines, with names for two or for several states (OPC 10000-8).

The names are stored once, at the type of the drive or line; every instance refers to them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, get_args

from asyncua import ua

from drivecomm.plant.watching import Reachability
from drivecomm.protocol import DriveState
from drivecomm.server.opcua.nodes import PROPERTY, standard
from drivecomm.server.opcua.values import waiting

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.server.opcua.nodes import Nodes

STATES = tuple(each.value for each in DriveState)
"""States of a drive, numbered from 0."""
REACHABILITIES: tuple[str, ...] = get_args(Reachability)
"""Results of the last request to a drive, numbered from 0."""

_SEVERAL: Mapping[str, tuple[str, ...]] = {"State": STATES, "Reachability": REACHABILITIES}
_TWO: Mapping[str, tuple[str, str]] = {
    "Running": ("stopped", "running"),
    "Fault": ("no fault", "fault"),
    "Warning": ("no warning", "warning"),
    "AtReference": ("not at reference", "at reference"),
    "Reverse": ("forward", "reverse"),
    "Up": ("down", "up"),
}
"""Names of false and true."""
DRIVE, LINE = (*_SEVERAL, *(name for name in _TWO if name != "Up")), ("Up",)
"""State variables of a drive and of a line."""


def make_state(nodes: Nodes, parent: ua.NodeId, node: ua.NodeId, name: str, declared: ua.NodeId) -> None:
    """Create a state variable. declared: the node that `declare_states` has created for this name."""
    if name in _TWO:
        kind, data_type = standard(ua.ObjectIds.TwoStateDiscreteType), ua.ObjectIds.Boolean
    else:
        kind, data_type = standard(ua.ObjectIds.MultiStateDiscreteType), ua.ObjectIds.UInt32
    nodes.variable(parent, node, name, waiting(), data_type, kind=kind)
    if node != declared:
        for each in nodes.references(declared):
            if each.IsForward and each.ReferenceTypeId == PROPERTY:
                nodes.refer(node, each.NodeId, PROPERTY)


def declare_states(nodes: Nodes, kind: ua.NodeId, names: tuple[str, ...]) -> None:
    """Add state variables and the names of their states to a type."""
    for name in names:
        node = nodes.id(str(kind.Identifier), name)
        make_state(nodes, kind, node, name, node)
        if name in _TWO:
            for word, text in zip(("FalseState", "TrueState"), _TWO[name], strict=True):
                told = ua.Variant(ua.LocalizedText(text), ua.VariantType.LocalizedText)
                nodes.property(node, nodes.id(str(node.Identifier), word), word, told, ua.ObjectIds.LocalizedText)
        else:
            texts = [ua.LocalizedText(each) for each in _SEVERAL[name]]
            told = ua.Variant(texts, ua.VariantType.LocalizedText, is_array=True)
            below = nodes.id(str(node.Identifier), "EnumStrings")
            rank = ua.ValueRank.OneDimension
            nodes.property(node, below, "EnumStrings", told, ua.ObjectIds.LocalizedText, rank=rank)
