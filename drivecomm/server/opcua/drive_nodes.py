"""The fixed nodes of each drive, independent of its polled values: status, identification, logbook and lock."""

from __future__ import annotations

import time
from functools import partial
from typing import TYPE_CHECKING, Any

from asyncua import ua

from drivecomm.server.opcua.naming import part
from drivecomm.server.opcua.nodes import FOLDER, ORGANIZES
from drivecomm.server.opcua.states import DRIVE, REACHABILITIES, STATES, make_state
from drivecomm.server.opcua.value_facts import monitoring_only
from drivecomm.server.opcua.values import LAST_USABLE, NOT_YET, STATUS_CODES, as_stale, good, missing, moment, waiting

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from asyncua.server.address_space import AttributeValue

    from drivecomm.protocol import DriveConfig, DriveStatus
    from drivecomm.server import CurrentValue, DriveSnapshot, Lease
    from drivecomm.server.opcua.nodes import Nodes

    Asked = Callable[[DriveStatus], Any]

_BOOLEAN, _TEXT, _WORD, _DOUBLE = (
    (ua.ObjectIds.Boolean, ua.VariantType.Boolean),
    (ua.ObjectIds.String, ua.VariantType.String),
    (ua.ObjectIds.UInt32, ua.VariantType.UInt32),
    (ua.ObjectIds.Duration, ua.VariantType.Double),
)

_OF_WORD: Mapping[str, tuple[tuple[int, ua.VariantType], Asked]] = {
    "State": (_WORD, lambda status: STATES.index(status.state.value)),
    "Running": (_BOOLEAN, lambda status: status.running),
    "Fault": (_BOOLEAN, lambda status: status.fault),
    "Warning": (_BOOLEAN, lambda status: status.warning),
    "AtReference": (_BOOLEAN, lambda status: status.at_reference),
    "Reverse": (_BOOLEAN, lambda status: status.reverse),
    "StatusWord": (_WORD, lambda status: status.word & 0xFFFFFFFF),
    "FaultText": (_TEXT, lambda status: status.fault_text),
}
"""Variables with the contents of the status word, by name."""

_OF_SERVER = ("Error", "KeptRunning", "StandingStop", "Drift")
_NOT_SAID = ua.StatusCode(ua.UInt32(ua.StatusCodes.BadNotSupported))


class DriveNodes:
    """Nodes of one drive. kind: their type."""

    def __init__(self, name: str, nodes: Nodes, kind: ua.NodeId) -> None:
        self.name = name
        self.node = nodes.id("drives", part(name))
        self._nodes, self._kind = nodes, kind
        self._until: float | None = None
        self._is_free = False
        self._shown: dict[str, object] = {}
        self._status: list[AttributeValue] = []
        self._state: DriveSnapshot | None = None
        self._value: CurrentValue | None = None
        self._seen_s = 0.0
        self._is_old = False

    def _id(self, *parts: str) -> ua.NodeId:
        return self._nodes.id("drives", part(self.name), *parts)

    async def make(self, config: DriveConfig) -> None:
        """Create the nodes."""
        nodes = self._nodes
        nodes.make_object(
            nodes.id("drives"), self.node, self.name, kind=self._kind, by=ORGANIZES, about=config.title, notifies=True
        )
        for folder in ("Status", "Identification", "Logbook"):
            nodes.make_object(self.node, self._id(folder), folder, kind=FOLDER)
        self._status = []
        for name, ((data_type, _), _asked) in _OF_WORD.items():
            node = self._id("Status", name)
            self._make_status(name, data_type)
            self._status.append(nodes.make_when_read(node, partial(self._status_told, name)))
        for name in ("Reachability", *_OF_SERVER):
            self._make_status(name, ua.ObjectIds.String)
        said = {
            "Line": config.line, "Protocol": config.protocol, "Address": str(config.address), "Title": config.title,
            "Model": str(config.options.get("model") or ""),
        }  # fmt: skip
        for name, value in said.items():
            nodes.variable(self._id("Identification"), self._id("Identification", name), name, waiting(), _TEXT[0])
            await self._change(("Identification", name), value, ua.VariantType.String)
        only_read = self._id("Identification", "MonitoringOnly")
        nodes.variable(self._id("Identification"), only_read, "MonitoringOnly", waiting(), _BOOLEAN[0])
        await self._change(("Identification", "MonitoringOnly"), monitoring_only(config), _BOOLEAN[1])
        rank = ua.ValueRank.OneDimension
        entries = self._id("Logbook", "Entries")
        nodes.variable(self._id("Logbook"), entries, "Entries", good([], _TEXT[1]), _TEXT[0], rank=rank)
        self._make_lock()

    def _make_status(self, name: str, data_type: int) -> None:
        nodes, folder = self._nodes, self._id("Status")
        if name in DRIVE:
            make_state(nodes, folder, self._id("Status", name), name, nodes.id(str(self._kind.Identifier), name))
        else:
            nodes.variable(folder, self._id("Status", name), name, waiting(), data_type)

    def _make_lock(self) -> None:
        nodes, lock = self._nodes, self._id("Lock")
        nodes.make_object(self.node, lock, "Lock")
        for name, (data_type, kind), value in (
            ("Locked", _BOOLEAN, False), ("LockingUser", _TEXT, ""), ("LockingClient", _TEXT, ""),
            ("RemainingLockTime", _DOUBLE, 0.0),
        ):  # fmt: skip
            nodes.variable(lock, self._id("Lock", name), name, good(value, kind), data_type)

    @property
    def lock(self) -> ua.NodeId:
        """Node of the drive's lock."""
        return self._id("Lock")

    async def show(self, state: DriveSnapshot, value: CurrentValue | None) -> None:
        """Show the state of the drive. value: its polled status, None before the first poll."""
        if value is not None:
            self._until = time.monotonic() + value.keeps_s
        self._state, self._value, self._seen_s, self._is_old = state, value, time.time(), False
        await self._tell_status()
        reachability = REACHABILITIES.index(state.reachability)
        await self._change(("Status", "Reachability"), reachability, ua.VariantType.UInt32)
        told_now = state.error, state.kept, str(state.standing_stop or ""), str(state.drift)
        for name, text in zip(_OF_SERVER, told_now, strict=True):
            await self._change(("Status", name), text, ua.VariantType.String)
        entries = [f"{each.address}: {each.value} {each.text}".rstrip() for each in state.fault_log]
        await self._change(("Logbook", "Entries"), entries, ua.VariantType.String)

    async def look(self, time_s: float) -> None:
        """Mark the status as stale if no new one has arrived in time. time_s: by `time.monotonic`."""
        if self._until is None or time_s <= self._until:
            return
        self._until, self._is_old = None, True
        await self._tell_status()

    async def show_lock(self, lease: Lease | None) -> None:
        """Show the holder of the drive's lease."""
        if lease is None and self._is_free:
            return
        self._is_free = lease is None
        left_ms = 0.0 if lease is None else max(0.0, lease.until_s - time.time()) * 1000
        told: tuple[tuple[str, object, ua.VariantType], ...] = (
            ("Locked", lease is not None, ua.VariantType.Boolean),
            ("LockingUser", "" if lease is None else lease.holder.name, ua.VariantType.String),
            ("LockingClient", "" if lease is None else lease.holder.door, ua.VariantType.String),
            ("RemainingLockTime", round(left_ms, -2), ua.VariantType.Double),
        )
        for name, value, kind in told:
            await self._change(("Lock", name), value, kind)

    async def _tell_status(self) -> None:
        for attribute in self._status:
            await self._nodes.changed(attribute)

    def _status_told(self, name: str) -> ua.DataValue:
        state = self._state
        if state is None:
            return waiting()
        (_, kind), asked = _OF_WORD[name]
        told = None if state.status is None else asked(state.status)
        if name == "FaultText" and state.status is not None:
            told = state.fault
        found = _told(state, self._value, told, kind, self._seen_s)
        return as_stale(found) if self._is_old else found

    async def _change(self, place: tuple[str, str], value: object, kind: ua.VariantType) -> None:
        """Set a variable if its value has changed."""
        key = "/".join(place)
        if key not in self._shown or self._shown[key] != value:
            self._shown[key] = value
            await self._nodes.write(self._id(*place), good(value, kind))


def _told(
    state: DriveSnapshot, value: CurrentValue | None, told: Any, kind: ua.VariantType, seen_s: float
) -> ua.DataValue:
    if state.status is None:
        never = state.reachability == "asking"
        return ua.DataValue(None, NOT_YET) if never else missing(seen_s if value is None else value.time_s, seen_s)
    source_s = state.answered_s if value is None else value.source_s
    quality = "stale" if value is None else value.quality
    code = STATUS_CODES.get(quality, LAST_USABLE) if told is not None else _NOT_SAID
    variant = ua.Variant(told, kind) if told is not None else ua.Variant(None, ua.VariantType.Null)
    return ua.DataValue(variant, code, None if source_s is None else moment(source_s), moment(seen_s))
