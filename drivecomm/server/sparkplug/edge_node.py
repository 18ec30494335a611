"""The plant as an edge node and its drives as devices: the births, deaths and data that are due.

It stores what hosts have received in this session and compares. It sends nothing and reads no clock.
"""

from __future__ import annotations

from collections import defaultdict
from contextlib import suppress
from dataclasses import dataclass, field
from operator import attrgetter
from typing import TYPE_CHECKING, TypeAlias

from drivecomm.errors import UsageError
from drivecomm.line import STATUS
from drivecomm.server.sparkplug.metrics import (
    QUALITY,
    REASON,
    UNCERTAIN,
    VALUES,
    commander_texts,
    metrics_of_answer,
    metrics_of_drive,
    metrics_of_past,
    metrics_of_value,
    milliseconds,
    same,
    unit_of,
    unread,
    with_unit,
)
from drivecomm.server.sparkplug.payload import DataType, Metric
from drivecomm.server.sparkplug.topics import Kind, alias_of, device_ids
from drivecomm.version import __version__

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
    from decimal import Decimal

    from drivecomm.protocol import DriveConfig
    from drivecomm.server import CommandAnswer, CommandRequest, CurrentValue, DriveSnapshot, PastValue, ServedPlant

BD_SEQ = "bdSeq"
REBIRTH = "Node Control/Rebirth"
SESSION = "Properties/Session"

Limits: TypeAlias = "Callable[[DriveConfig, str, str], tuple[Decimal | None, Decimal | None]]"
"""Function that returns the lowest and highest value of a drive's quantity in a unit, None if the model lacks them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Unsent:
    """Message to be sent; its sequence number is assigned when it leaves."""

    kind: Kind
    device: str = ""
    metrics: tuple[Metric, ...] = ()


@dataclass(slots=True)
class _Device:
    """Drive in the view of hosts.

    name: name from which the id was made. told: last sent state of each metric, empty before the birth. seen: last
    examined content of each value.
    """

    id: str
    name: str = ""
    config: DriveConfig | None = None
    born: bool = False
    told: dict[str, Metric] = field(default_factory=dict)
    seen: dict[str, object] = field(default_factory=dict)
    answer: tuple[CommandRequest, CommandAnswer, str] | None = None


class EdgeNode:
    """Plant in the view of hosts.

    commands: returns the command metrics of a drive by name. limits: limits of its quantities. device_name: returns the
    device name of a drive.
    """

    def __init__(
        self,
        plant: ServedPlant,
        commands: Callable[[str], Sequence[Metric]],
        limits: Limits,
        device_name: Callable[[DriveSnapshot], str] = attrgetter("name"),
    ) -> None:
        self._plant, self._commands, self._limits, self._device_name = plant, commands, limits, device_name
        self._bd_seq = 0
        self._devices: dict[str, _Device] = {}
        self._values: dict[str, dict[str, CurrentValue]] = {}
        self._told: dict[str, Metric] = {}
        self._aliases: dict[tuple[str, str], int] = {}
        self._named: dict[int, tuple[str, str]] = {}

    def births(self, bd_seq: int, time_s: float) -> list[Unsent]:
        """Return all births, that of the edge node first. bd_seq: bdSeq number of this connection."""
        self._bd_seq = bd_seq
        self._read_values()
        states = {drive.name: drive for drive in self._plant.drives()}
        names = self._names(states.values())
        self._devices = {
            drive: _Device(each, names[drive], answer=before.answer if (before := self._devices.get(drive)) else None)
            for drive, each in device_ids(names).items()
        }
        self._told = {each.name: each for each in self._of_node(milliseconds(time_s))}
        fixed = [
            Metric(name=BD_SEQ, type=DataType.INT64, time_ms=milliseconds(time_s), value=bd_seq),
            Metric(name=REBIRTH, type=DataType.BOOLEAN, time_ms=milliseconds(time_s), value=False),
        ]
        node = [*fixed, *(self._with_alias("", each) for each in self._told.values())]
        return [Unsent(kind="NBIRTH", metrics=tuple(node)), *self._of_drives(states.values(), time_s)]

    def changed(self, values: Iterable[CurrentValue], drives: Collection[str], time_s: float) -> list[Unsent]:
        """Return the messages for changed values, and for other changes of these drives."""
        by_drive: dict[str, dict[str, CurrentValue]] = defaultdict(dict)
        for value in values:
            by_drive[value.drive][value.name] = value
        for drive, found in by_drive.items():
            self._values.setdefault(drive, {}).update(found)
        known = [drive for drive in {**by_drive, **dict.fromkeys(drives)} if drive in self._devices]
        return self._of_drives(self._states(known), time_s, by_drive)

    def periodic_messages(self, time_s: float) -> list[Unsent]:
        """Return messages for changes without an event: stale values, added or removed drives, lines, commanders."""
        states = {drive.name: drive for drive in self._plant.drives()}
        if self._names(states.values()) != {drive: device.name for drive, device in self._devices.items()}:
            return self._renamed(states, time_s)
        aged = {
            drive: {name: each for name, each in values.items() if each.quality_at(time_s) != each.quality}
            for drive, values in self._values.items()
        }
        found = self._of_drives(states.values(), time_s, aged)
        now = {each.name: each for each in self._of_node(milliseconds(time_s))}
        if set(now) != set(self._told):
            # A line was added or removed, which needs a new birth of the edge node.
            return self.births(self._bd_seq, time_s)
        changed = [each for name, each in now.items() if not same(each, self._told[name])]
        self._told.update({each.name: each for each in changed})
        data = tuple(self._as_data("", each) for each in changed)
        return [*([Unsent(kind="NDATA", metrics=data)] if data else []), *found]

    def answered(self, command: CommandRequest, answer: CommandAnswer, text: str, time_s: float) -> list[Unsent]:
        """Return messages with the outcome of a command."""
        device = self._devices.get(command.drive)
        if device is None:
            return []
        device.answer = command, answer, text
        metrics = metrics_of_answer(command, answer, text, milliseconds(time_s))
        # All answer metrics, even unchanged ones, because this is a new answer.
        return self._data(command.drive, device, metrics) if device.born else []

    def past(self, drive: str, values: Iterable[PastValue]) -> list[Unsent]:
        """Return messages with past values, marked as historical, for metrics that are in the drive's birth."""
        device = self._devices.get(drive)
        if device is None or not device.born:
            return []
        metrics = [
            self._as_data(drive, metric)
            for value in values
            for metric in metrics_of_past(value)
            if (told := device.told.get(metric.name)) is not None and told.type is metric.type
        ]
        return [Unsent(kind="DDATA", device=device.id, metrics=tuple(metrics))] if metrics else []

    def is_born(self, drive: str) -> bool:
        """Whether this drive is born."""
        device = self._devices.get(drive)
        return device is not None and device.born

    def drive_of(self, device: str) -> str | None:
        """Return the drive of a device, None for an unknown device."""
        # Also before the births, so that a stop always finds its drive.
        born = {drive: each.id for drive, each in self._devices.items()}
        known = born or device_ids(self._names(self._plant.drives()))
        return next((drive for drive, each in known.items() if each == device), None)

    def named(self, drive: str, metric: Metric) -> Metric:
        """Return a metric of a command with its name instead of its alias. Raises UsageError for an unknown alias."""
        if metric.alias is None:
            return metric
        of, name = self._named.get(metric.alias, (None, ""))
        if of != drive or metric.name not in ("", name):
            raise UsageError(f"the alias {metric.alias} is unknown in {drive or 'the edge node'}; read its birth again")
        return metric._replace(name=name)

    def _renamed(self, there: Mapping[str, DriveSnapshot], time_s: float) -> list[Unsent]:
        """Return messages for added, removed or renamed drives."""
        names = self._names(there.values())
        stay = {drive: each for drive, each in self._devices.items() if names.get(drive) == each.name}
        gone = [
            Unsent(kind="DDEATH", device=each.id)
            for drive, each in self._devices.items()
            if drive not in stay and each.born
        ]
        self._devices = {
            drive: stay.get(drive) or _Device(each, names[drive]) for drive, each in device_ids(names).items()
        }
        self._read_values()
        return [*gone, *self._of_drives(there.values(), time_s, self._values)]

    def _names(self, drives: Iterable[DriveSnapshot]) -> dict[str, str]:
        """Return device names by drive."""
        return {drive.name: self._device_name(drive) for drive in drives}

    def _read_values(self) -> None:
        self._values = {}
        for value in self._plant.values():
            self._values.setdefault(value.drive, {})[value.name] = value

    def _states(self, drives: Iterable[str]) -> Iterator[DriveSnapshot]:
        for drive in drives:
            # A drive that was just removed is reported by `periodic_messages`.
            with suppress(UsageError):
                yield self._plant.drive(drive)

    def _of_drives(
        self,
        states: Iterable[DriveSnapshot],
        time_s: float,
        values: Mapping[str, Mapping[str, CurrentValue]] | None = None,
    ) -> list[Unsent]:
        """Return births, deaths and data of these drives. values: values that may have changed."""
        found: list[Unsent] = []
        for state in states:
            drive = state.name
            device = self._devices[drive]
            if state.reachability != "answers":
                if device.born:
                    device.born = False
                    found.append(Unsent(kind="DDEATH", device=device.id))
                continue
            if device.born and state.config == device.config:
                fresh = self._changes(device, state, (values or {}).get(drive, {}).values(), time_s)
                if fresh is not None:
                    found += self._data(drive, device, fresh)
                    continue
            found.append(self._birth(drive, device, state, time_s))
        return found

    def _birth(self, drive: str, device: _Device, state: DriveSnapshot, time_s: float) -> Unsent:
        time_ms = milliseconds(time_s)
        if device.born:
            # The drive was changed in the plant file, and with it its values.
            self._read_values()
        metrics = [*metrics_of_drive(state, time_ms), *self._commands(drive)]
        command, answer, text = device.answer or (None, None, "")
        metrics += metrics_of_answer(command, answer, text, time_ms)
        for value in {**unread(state.config, time_s), **self._values.get(drive, {})}.values():
            of_value = metrics_of_value(value, state, value.quality_at(time_s), time_s)
            if of_value[0].name == VALUES + value.name:
                unit = unit_of(value)
                of_value = [with_unit(of_value[0], unit, self._limits(state.config, value.name, unit))]
            metrics += of_value
        device.config, device.born = state.config, True
        device.told, device.seen = {each.name: each for each in metrics}, {}
        metrics = [self._with_alias(drive, each._replace(time_ms=each.time_ms or time_ms)) for each in metrics]
        return Unsent(kind="DBIRTH", device=device.id, metrics=_in_order(metrics))

    def _changes(
        self, device: _Device, state: DriveSnapshot, values: Iterable[CurrentValue], time_s: float
    ) -> list[Metric] | None:
        """Return the changed metrics of a drive; None if the change needs a new birth."""
        found = []
        for value in values:
            quality = value.quality_at(time_s)
            said = _said(value, state), quality, value.cause
            if device.seen.get(value.name) == said:
                # Unchanged, which is the most frequent case.
                continue
            device.seen[value.name] = said
            for metric in metrics_of_value(value, state, quality, time_s):
                told = device.told.get(metric.name)
                if told is None or (told.type is not metric.type and metric.value is not None):
                    return None
                if not same(told, metric):
                    # The time of a metric never decreases, even if a clock is set back. Its type stays without a value.
                    time_ms = max(metric.time_ms or 0, told.time_ms or 0)
                    found.append(metric._replace(type=told.type, time_ms=time_ms))
        for name, text in commander_texts(state).items():
            if device.told[name].value != text:
                found.append(device.told[name]._replace(value=text, time_ms=milliseconds(time_s)))
        return found

    def _data(self, drive: str, device: _Device, metrics: Sequence[Metric]) -> list[Unsent]:
        if not metrics:
            return []
        device.told.update({each.name: each for each in metrics})
        said = _in_order([self._as_data(drive, each) for each in metrics])
        return [Unsent(kind="DDATA", device=device.id, metrics=said)]

    def _of_node(self, time_ms: int) -> list[Metric]:
        texts = {
            "Properties/Software": f"drivecomm {__version__}",
            "Properties/Plant": self._plant.name,
            SESSION: self._plant.session,
        }
        lines = {f"Lines/{line.name}/Up": line.up for line in self._plant.lines()}
        return [
            *(Metric(name=name, type=DataType.STRING, time_ms=time_ms, value=text) for name, text in texts.items()),
            *(Metric(name=name, type=DataType.BOOLEAN, time_ms=time_ms, value=up) for name, up in lines.items()),
        ]

    def _with_alias(self, drive: str, metric: Metric) -> Metric:
        key = drive, metric.name
        alias = self._aliases.get(key)
        if alias is None:
            alias = alias_of(*key)
            while alias in self._named:
                alias += 1
            self._aliases[key], self._named[alias] = alias, key
        return metric._replace(alias=alias)

    def _as_data(self, drive: str, metric: Metric) -> Metric:
        """Return a metric for a data message: alias instead of name, and only the properties that can change."""
        kept = metric.properties
        if not kept.keys() <= _CHANGING:
            kept = {key: each for key, each in kept.items() if key in _CHANGING}
        return self._with_alias(drive, metric)._replace(name="", properties=kept)


def _said(value: CurrentValue, state: DriveSnapshot) -> object:
    """Return the content of a value, without its quality."""
    if value.name == STATUS:
        return state.status
    return None if value.reading is None else (value.reading.value, value.reading.remark)


_CHANGING = frozenset({QUALITY, UNCERTAIN, REASON})


def _in_order(metrics: Iterable[Metric]) -> tuple[Metric, ...]:
    """Return metrics sorted by time, as hosts may expect within a message."""
    return tuple(sorted(metrics, key=lambda each: each.time_ms or 0))
