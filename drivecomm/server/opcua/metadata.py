"""Self-description of the server: facets, limits per request, our namespace and build information."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from asyncua import ua

from drivecomm import version
from drivecomm.server.opcua import limits
from drivecomm.server.opcua.instances import make_variable
from drivecomm.server.opcua.nodes import COMPONENT, standard
from drivecomm.server.opcua.values import good
from drivecomm.version import __version__

if TYPE_CHECKING:
    from asyncua import Server

    from drivecomm.server.opcua.nodes import Nodes

NAMESPACE = "urn:drivecomm:plant"
# The time of installation: an installed package has no build date.
_BUILT = datetime.fromtimestamp(Path(version.__file__).stat().st_mtime, UTC)
_PROFILES = "http://opcfoundation.org/UA-Profile/Server/"
_FACETS = (
    "DataAccess", "Methods", "EmbeddedDataChangeSubscription", "StandardEventSubscription", "AddressSpaceNotifier",
    "ACBaseCondition", "ACRefresh2", "ACAddressSpaceInstance", "ACAlarm", "ACAckAlarm", "ACExclusiveAlarming",
)  # fmt: skip
"""Facets of Part 7 whose services are implemented; none is certified."""
_OF_HISTORY = ("HistoricalRawData", "AggregateHistorical")
_AT_ONCE = {
    "MaxNodesPerRead": limits.NODES_AT_ONCE,
    "MaxNodesPerWrite": limits.NODES_AT_ONCE,
    "MaxNodesPerBrowse": limits.NODES_AT_ONCE,
    "MaxNodesPerTranslateBrowsePathsToNodeIds": limits.NODES_AT_ONCE,
    "MaxMonitoredItemsPerCall": limits.NODES_AT_ONCE,
    "MaxNodesPerHistoryReadData": limits.HISTORIES_AT_ONCE,
    "MaxNodesPerMethodCall": limits.CALLS_AT_ONCE,
}


async def describe(server: Server, nodes: Nodes, *, has_history: bool) -> None:
    """Fill in the standard nodes that describe the server. nodes: nodes of our namespace."""
    await server.set_build_info("urn:drivecomm", "drivecomm", "drivecomm", __version__, __version__, _BUILT)
    facets = [_PROFILES + each for each in (*_FACETS, *(_OF_HISTORY if has_history else ()))]
    told: list[tuple[str, Any, ua.VariantType]] = [
        ("ServerCapabilities_ServerProfileArray", facets, ua.VariantType.String),
        *(
            (f"ServerCapabilities_OperationLimits_{name}", most, ua.VariantType.UInt32)
            for name, most in _AT_ONCE.items()
        ),
    ]
    for name, value, kind in told:
        await nodes.write(standard(getattr(ua.ObjectIds, f"Server_{name}")), good(value, kind))
    if has_history:
        reads = standard(ua.ObjectIds.HistoryServerCapabilities_AccessHistoryDataCapability)
        most = standard(ua.ObjectIds.HistoryServerCapabilities_MaxReturnDataValues)
        await nodes.write(reads, good(True, ua.VariantType.Boolean))
        await nodes.write(most, good(limits.PAST_VALUES, ua.VariantType.UInt32))
    await _describe_namespace(nodes)


async def _describe_namespace(nodes: Nodes) -> None:
    kind = standard(ua.ObjectIds.NamespaceMetadataType)
    parent, node = standard(ua.ObjectIds.Server_Namespaces), nodes.id("namespace")
    nodes.make_object(parent, node, NAMESPACE, kind=kind, by=COMPONENT)
    for name, value, variant in (
        ("NamespaceUri", NAMESPACE, ua.VariantType.String),
        ("NamespaceVersion", __version__, ua.VariantType.String),
        ("NamespacePublicationDate", _BUILT, ua.VariantType.DateTime),
        ("IsNamespaceSubset", False, ua.VariantType.Boolean),
        # Node ids contain names of the plant, so none is the same on every server.
        ("StaticNodeIdTypes", [], ua.VariantType.Int32),
        ("StaticNumericNodeIdRange", [], ua.VariantType.String),
        ("StaticStringNodeIdPattern", None, ua.VariantType.String),
    ):
        await nodes.write(make_variable(nodes, node, kind, name), good(value, variant))
