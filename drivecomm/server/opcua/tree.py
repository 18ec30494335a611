"""The plant as nodes: its lines and its drives, with their status, identification, lock, commands and values.

The nodes of a drive are below the drive, because many children of one folder take asyncua quadratic time.
"""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from asyncua import ua

from drivecomm.errors import DriveCommError
from drivecomm.line import STATUS, items_of
from drivecomm.plant import model_of
from drivecomm.server.opcua.aggregates import AGGREGATES
from drivecomm.server.opcua.drive_nodes import DriveNodes
from drivecomm.server.opcua.naming import engineering_unit, part, place_of, value_path
from drivecomm.server.opcua.nodes import (
    ANALOG,
    FOLDER,
    NOTIFIER,
    ORGANIZES,
    PROPERTY,
    PROPERTY_TYPE,
    VARIABLE,
    standard,
)
from drivecomm.server.opcua.states import LINE, make_state
from drivecomm.server.opcua.value_facts import facts_of
from drivecomm.server.opcua.values import GOOD, as_stale, data_value, good, moment, waiting
from drivecomm.version import __version__

if TYPE_CHECKING:
    from collections.abc import Iterable

    from asyncua.server.address_space import AttributeValue

    from drivecomm.plant import Plant
    from drivecomm.protocol import DriveConfig
    from drivecomm.server import CurrentValue, ServedPlant
    from drivecomm.server.opcua.methods import Methods
    from drivecomm.server.opcua.nodes import Nodes
    from drivecomm.server.opcua.value_facts import Facts

_DATA_TYPES = {
    None: ua.ObjectIds.BaseDataType,
    ua.VariantType.Double: ua.ObjectIds.Double,
    ua.VariantType.String: ua.ObjectIds.String,
}
_OF_LINE = (
    ("Up", ua.ObjectIds.Boolean, ua.VariantType.Boolean),
    ("Error", ua.ObjectIds.String, ua.VariantType.String),
    ("Polls", ua.ObjectIds.UInt64, ua.VariantType.UInt64),
    ("MissedPolls", ua.ObjectIds.UInt64, ua.VariantType.UInt64),
    ("LateStatuses", ua.ObjectIds.UInt64, ua.VariantType.UInt64),
)


@dataclass(slots=True)
class _Shown:
    """Polled value.

    value: as last received, at seen_s in seconds since 1970. until: time by `time.monotonic` at which it becomes stale;
    None if it is stale or missing. attribute: shows the value. note_attribute: shows the remark on it.
    """

    kind: ua.VariantType | None
    value: CurrentValue | None = None
    seen_s: float = 0.0
    until: float | None = None
    attribute: AttributeValue | None = None
    note_attribute: AttributeValue | None = None

    def take(self, value: CurrentValue, seen_s: float) -> None:
        self.value, self.seen_s, self.until = value, seen_s, time.monotonic() + value.keeps_s

    def told(self) -> ua.DataValue:
        if self.value is None:
            return waiting()
        found = data_value(self.value, self.kind, self.seen_s)
        return found if self.until is not None else as_stale(found)

    def note(self) -> ua.DataValue:
        return _text("" if self.value is None else self.value.remark)


class PlantTree:
    """Nodes of a plant. `sync` builds them from the plant file, `take` sets their values."""

    def __init__(self, plant: ServedPlant, nodes: Nodes, methods: Methods) -> None:
        self._plant, self._nodes, self._methods = plant, nodes, methods
        self._built: Plant | None = None
        self._values: dict[tuple[str, str], _Shown] = {}
        self._history: dict[ua.NodeId, tuple[str, str]] = {}
        self._drives: dict[str, DriveNodes] = {}
        self._by_node: dict[ua.NodeId, str] = {}
        self._lines: dict[str, tuple[object, ...]] = {}
        self._of_lines: dict[str, list[AttributeValue]] = {}
        self.root = nodes.id("plant")
        self.types = methods.made()
        self._make_root()

    def value_at(self, node: ua.NodeId) -> tuple[str, str] | None:
        """Return drive and name of the value of a node, None for a node without history."""
        return self._history.get(node)

    def drive_at(self, node: ua.NodeId) -> str | None:
        """Return the name of the drive of a node, None for another node."""
        return self._by_node.get(node)

    def node_of(self, drive: str) -> ua.NodeId | None:
        """Return the node of a drive, None for an unknown drive."""
        known = self._drives.get(drive)
        return None if known is None else known.node

    async def sync(self) -> None:
        """Rebuild the nodes if the plant file has been reloaded."""
        plant = self._plant.plant
        if plant is self._built:
            return
        before = {} if self._built is None else {each.name: each for each in self._built.drives}
        now = {each.name: each for each in plant.drives}
        for name in before.keys() - now.keys():
            await self._forget(name)
        for name, config in now.items():
            if before.get(name) != config:
                await self._make_drive(config)
            self._show_tags(config)
        await self._make_lines(plant)
        self._built = plant
        values = self._plant.values()
        await self.take(values)
        asked = {value.drive for value in values if value.name == STATUS}
        for name in self._drives.keys() - asked:
            await self._show(name, None)

    async def take(self, values: Iterable[CurrentValue]) -> None:
        """Show new values and the states of their drives."""
        statuses, seen_s = {}, time.time()
        for value in values:
            if value.name == STATUS:
                statuses[value.drive] = value
            elif (shown := self._values.get((value.drive, value.name))) is not None:
                shown.take(value, seen_s)
                await self._tell(shown)
        for name, value in statuses.items():
            if name in self._drives:
                await self._show(name, value)

    async def look(self) -> None:
        """Update the nodes that change with time alone: stale values, leases, and the states of lines."""
        now = time.monotonic()
        for shown in self._values.values():
            if shown.until is not None and shown.until < now:
                shown.until = None
                await self._tell(shown)
        for drive in self._drives.values():
            await drive.look(now)
        leases = {lease.drive: lease for lease in self._plant.leases()}
        for name, drive in self._drives.items():
            await drive.show_lock(leases.get(name))
        for line in self._plant.lines():
            told = line.up, line.error, line.polls, line.missed, line.late_statuses
            if self._lines.get(line.name) != told:
                self._lines[line.name] = told
                for attribute in self._of_lines.get(line.name, ()):
                    await self._nodes.changed(attribute)

    async def _show(self, name: str, status: CurrentValue | None) -> None:
        # A drive that is just being replaced is shown later.
        with suppress(DriveCommError):
            await self._drives[name].show(self._plant.drive(name), status)

    async def _tell(self, shown: _Shown) -> None:
        for attribute in (shown.attribute, shown.note_attribute):
            if attribute is not None:
                await self._nodes.changed(attribute)

    def _make_root(self) -> None:
        nodes, plant = self._nodes, self._plant
        nodes.make_object(
            standard(ua.ObjectIds.ObjectsFolder), self.root, "Plant", by=ORGANIZES, about=plant.name, notifies=True
        )
        for name, value in (("Name", plant.name), ("SoftwareVersion", __version__), ("Session", plant.session)):
            nodes.variable(self.root, nodes.id("plant", name), name, _text(value), ua.ObjectIds.String)
        started = ua.DataValue(ua.Variant(moment(plant.started_s), ua.VariantType.DateTime), GOOD)
        nodes.variable(self.root, nodes.id("plant", "StartTime"), "StartTime", started, ua.ObjectIds.UtcTime)
        for name in ("Lines", "Drives"):
            nodes.make_object(self.root, nodes.id(name.lower()), name, kind=FOLDER, by=ORGANIZES)
        nodes.notifies(standard(ua.ObjectIds.Server))
        nodes.refer(standard(ua.ObjectIds.Server), self.root, NOTIFIER)
        if plant.history is not None:
            for capabilities in (
                ua.ObjectIds.Server_ServerCapabilities_AggregateFunctions,
                ua.ObjectIds.HistoryServerCapabilities_AggregateFunctions,
            ):
                for aggregate in AGGREGATES:
                    nodes.refer(standard(capabilities), aggregate, ORGANIZES)
        self._methods.give_plant(self.root)

    async def _make_lines(self, plant: Plant) -> None:
        nodes = self._nodes
        for name in self._of_lines.keys() - {line.name for line in plant.lines}:
            del self._of_lines[name]
            self._lines.pop(name, None)
            await nodes.remove(set(nodes.below(nodes.id("lines", part(name)))))
        for line in plant.lines:
            node = nodes.id("lines", part(line.name))
            nodes.make_object(nodes.id("lines"), node, line.name, kind=self.types.line, by=ORGANIZES)
            self._of_lines[line.name] = []
            for place, (name, data_type, kind) in enumerate(_OF_LINE):
                shown = nodes.id("lines", part(line.name), name)
                if name in LINE:
                    make_state(nodes, node, shown, name, nodes.id(str(self.types.line.Identifier), name))
                else:
                    nodes.variable(node, shown, name, waiting(), data_type)
                make = partial(self._line_told, line.name, place, kind)
                self._of_lines[line.name].append(nodes.make_when_read(shown, make))

    def _line_told(self, line: str, place: int, kind: ua.VariantType) -> ua.DataValue:
        told = self._lines.get(line)
        return waiting() if told is None else good(told[place], kind)

    async def _make_drive(self, config: DriveConfig) -> None:
        """Create the nodes of a drive; unchanged nodes of an earlier drive with this name stay."""
        nodes, name = self._nodes, config.name
        known = self._drives.get(name)
        before = set() if known is None else set(nodes.below(known.node))
        nodes.touched.clear()
        drive = self._drives[name] = known or DriveNodes(name, nodes, self.types.drive)
        self._by_node[drive.node] = name
        await drive.make(config)
        self._methods.give_drive(drive, config)
        if known is None:
            nodes.refer(self.root, drive.node, NOTIFIER)
        model = model_of(config)
        shown = {key: self._values.pop(key) for key in [key for key in self._values if key[0] == name]}
        for polled in dict.fromkeys(item.parameter for item in items_of(config.poll, config)):
            facts = facts_of(polled, model)
            self._values[name, polled] = shown.get((name, polled)) or _Shown(facts.kind)
            await self._make_value(drive.node, name, polled, facts)
        await nodes.remove(before - nodes.touched)

    def _show_tags(self, config: DriveConfig) -> None:
        for polled in dict.fromkeys(item.parameter for item in items_of(config.poll, config)):
            tag = config.tags.get(polled)
            shown = tag.name if tag and tag.name else place_of(polled).name
            self._nodes.display(self._nodes.id(*value_path(config.name, polled)), shown)

    async def _make_value(self, drive: ua.NodeId, name: str, polled: str, facts: Facts) -> None:
        nodes, place = self._nodes, place_of(polled)
        folder = nodes.id("drives", part(name), place.folder)
        nodes.make_object(drive, folder, place.folder, kind=FOLDER)
        node = nodes.id(*value_path(name, polled))
        data_type = standard(_DATA_TYPES[facts.kind])
        if nodes.data_type(node) not in (None, data_type):
            await nodes.remove(set(nodes.below(node)))
            self._values[name, polled] = _Shown(facts.kind)
        nodes.variable(
            folder, node, place.name, waiting(), _DATA_TYPES[facts.kind], kind=ANALOG if facts.unit else VARIABLE,
            about=facts.about, history=self._plant.history is not None,
        )  # fmt: skip
        below = str(node.Identifier)
        if facts.unit:
            unit = ua.Variant(engineering_unit(facts.unit), ua.VariantType.ExtensionObject)
            nodes.property(
                node, nodes.id(below, "EngineeringUnits"), "EngineeringUnits", unit, ua.ObjectIds.EUInformation
            )
        if facts.unit and facts.limits:
            low, high = facts.limits
            limits = ua.Variant(ua.Range(Low=low, High=high), ua.VariantType.ExtensionObject)
            nodes.property(node, nodes.id(below, "EURange"), "EURange", limits, ua.ObjectIds.Range)
        shown = self._values[name, polled]
        note = nodes.id(below, "Note")
        nodes.variable(node, note, "Note", _text(""), ua.ObjectIds.String, kind=PROPERTY_TYPE, by=PROPERTY)
        shown.note_attribute = nodes.make_when_read(note, shown.note)
        shown.attribute = nodes.make_when_read(node, shown.told)
        if self._plant.history is not None:
            self._history[node] = name, polled

    async def _forget(self, name: str) -> None:
        drive = self._drives.pop(name)
        self._by_node.pop(drive.node, None)
        self._nodes.refer_no_more(self.root, {drive.node})
        gone = set(self._nodes.below(drive.node))
        self._values = {key: each for key, each in self._values.items() if key[0] != name}
        self._history = {node: key for node, key in self._history.items() if node not in gone}
        await self._nodes.remove(gone)


def _text(value: str) -> ua.DataValue:
    return ua.DataValue(ua.Variant(value, ua.VariantType.String), GOOD)
