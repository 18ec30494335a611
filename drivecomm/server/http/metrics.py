"""Prometheus metrics of a plant, built at each scrape from the table of current values without asking a drive.

Common names become metrics in Prometheus base units. Stale values are left out, and each value has the time at which it
was read.
"""

from __future__ import annotations

import re
import time
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

from prometheus_client import CollectorRegistry, ProcessCollector
from prometheus_client.core import (
    CounterMetricFamily,
    GaugeMetricFamily,
    InfoMetricFamily,
    Metric,
    StateSetMetricFamily,
)
from prometheus_client.exposition import choose_encoder

from drivecomm.line import FRESH
from drivecomm.link import COUNTERS
from drivecomm.models import TEXT_QUANTITIES, quantities
from drivecomm.protocol import DriveState as Motion
from drivecomm.version import __version__

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from drivecomm.line import ResultQuality
    from drivecomm.models import Quantity
    from drivecomm.server import CurrentValue, DoorSnapshot, DriveSnapshot, ServedPlant
    from drivecomm.server.http.stream import Streams

_DRIVE = ("line", "drive")

# Unit of a quantity -> its Prometheus unit, and the factor into that unit.
_UNITS: Mapping[str, tuple[str, float]] = {
    "Hz": ("hertz", 1),
    "kHz": ("hertz", 1000),
    "Hz/s": ("hertz_per_second", 1),
    "A": ("amperes", 1),
    "V": ("volts", 1),
    "kW": ("watts", 1000),
    "kWh": ("joules", 3.6e6),
    "Nm": ("newton_meters", 1),
    "%": ("ratio", 0.01),
    "rpm": ("rpm", 1),
    "degC": ("celsius", 1),
    "h": ("seconds", 3600),
    "s": ("seconds", 1),
}
_COUNTED = frozenset({"operating_hours", "running_hours", "energy", "power_ups"})
_SAID_BY_UNIT = re.compile("_(hours|percent)$")


@dataclass(frozen=True, slots=True)
class _Name:
    """Metric of a common name. factor: from the unit of the quantity into that of the metric."""

    metric: str
    factor: float
    counts: bool
    about: str

    def family(self) -> GaugeMetricFamily | CounterMetricFamily:
        """Return the metric family, without samples."""
        return (CounterMetricFamily if self.counts else GaugeMetricFamily)(self.metric, self.about, labels=_DRIVE)


@cache
def names() -> Mapping[str, _Name]:
    """Return the metrics of all common names with numeric values."""
    return {name: _named(each) for name, each in quantities().items() if name not in TEXT_QUANTITIES}


def _named(quantity: Quantity) -> _Name:
    unit, factor = _UNITS[quantity.unit] if quantity.unit else ("", 1)
    short = _SAID_BY_UNIT.sub("", quantity.name)
    return _Name(
        "_".join(["drivecomm", short, *([unit] if unit else [])]),
        factor,
        quantity.name in _COUNTED,
        f"{quantity.meaning[0].upper()}{quantity.meaning[1:]}.",
    )


class PlantCollector:
    """Collector that prometheus_client runs at each scrape. door: name of the scraped door."""

    def __init__(self, plant: ServedPlant, door: str, streams: Streams) -> None:
        self._plant, self._door, self._streams = plant, door, streams

    def collect(self) -> Iterable[Metric]:
        """Yield all metrics."""
        drives = self._plant.drives()
        lines = {drive.name: drive.line for drive in drives}
        qualities = [(each, each.quality_at(time.time())) for each in self._plant.values() if each.drive in lines]
        values = [value for value, quality in qualities if quality in FRESH]
        yield from self._of_server()
        yield from _of_doors(self._plant.doors())
        yield from self._of_lines()
        yield from _of_drives(drives, values)
        yield from _of_counters(drives)
        yield from _of_values(lines, values)
        yield _of_qualities(lines, qualities)
        yield _of_notes(lines, values)

    def _of_server(self) -> Iterable[Metric]:
        yield InfoMetricFamily(
            "drivecomm_server", "The server and its plant.", {"version": __version__, "plant": self._plant.name}
        )
        yield GaugeMetricFamily(
            "drivecomm_server_start_time_seconds", "When the server was started.", self._plant.started_s
        )
        yield GaugeMetricFamily(
            "drivecomm_alarms", "Alarms that are on, or not acknowledged.", len(self._plant.alarms())
        )
        yield GaugeMetricFamily("drivecomm_leases", "Drives under a lease.", len(self._plant.leases()))
        streams = GaugeMetricFamily("drivecomm_door_streams", "Clients that listen to a stream.", labels=["door"])
        streams.add_metric([self._door], self._streams.clients)
        yield streams

    def _of_lines(self) -> Iterable[Metric]:
        up = GaugeMetricFamily("drivecomm_line_up", "Whether the line is open.", labels=["line", "port"])
        polls = CounterMetricFamily("drivecomm_line_polls", "Polls of the line.", labels=["line"])
        missed = CounterMetricFamily("drivecomm_line_missed_polls", "Polls that came too late.", labels=["line"])
        late = CounterMetricFamily(
            "drivecomm_line_late_statuses", "Status polls of drives that were not sent in time.", labels=["line"]
        )
        for line in self._plant.lines():
            up.add_metric([line.name, line.port], line.up)
            polls.add_metric([line.name], line.polls)
            missed.add_metric([line.name], line.missed)
            late.add_metric([line.name], line.late_statuses)
        yield from (up, polls, missed, late)


def _of_doors(doors: Iterable[DoorSnapshot]) -> Iterable[Metric]:
    up = GaugeMetricFamily("drivecomm_door_up", "Whether the door is open, and reaches its broker.", labels=["door"])
    clients = GaugeMetricFamily("drivecomm_door_clients", "Connections of clients that are open.", labels=["door"])
    backlog = GaugeMetricFamily(
        "drivecomm_door_backlog_rows",
        "Rows of the history that the door has not delivered yet; those of the last seconds may be under way.",
        labels=["door"],
    )
    for door in doors:
        up.add_metric([door.name], door.up)
        if door.clients is not None:
            clients.add_metric([door.name], door.clients)
        if door.backlog_rows is not None:
            backlog.add_metric([door.name], door.backlog_rows)
    yield from (up, clients, backlog)


def _of_drives(drives: Iterable[DriveSnapshot], values: Iterable[CurrentValue]) -> Iterable[Metric]:
    up = GaugeMetricFamily("drivecomm_drive_up", "Whether the drive answered its last poll.", labels=_DRIVE)
    info = InfoMetricFamily("drivecomm_drive", "Identity of the drive.", labels=_DRIVE)
    state = StateSetMetricFamily("drivecomm_drive_state", "State of the drive.", labels=_DRIVE)
    fault = GaugeMetricFamily("drivecomm_drive_fault", "Whether the drive has tripped.", labels=_DRIVE)
    changed = GaugeMetricFamily(
        "drivecomm_drive_changed_parameters", "Parameters that are not as in the drive's baseline.", labels=_DRIVE
    )
    replaced = GaugeMetricFamily(
        "drivecomm_drive_replaced", "Whether the drive differs from that of the baseline.", labels=_DRIVE
    )
    reply = GaugeMetricFamily("drivecomm_drive_reply_seconds", "Mean of the drive's reply times.", labels=_DRIVE)
    texts: dict[str, dict[str, str]] = {}
    for value in values:
        if value.name in TEXT_QUANTITIES and value.reading is not None:
            texts.setdefault(value.drive, {})[value.name] = str(value.reading.value)
    for drive in drives:
        labels = [drive.line, drive.name]
        config = drive.config
        up.add_metric(labels, drive.reachability == "answers")
        said = {"protocol": config.protocol, "address": str(config.address), "title": config.title}
        said["model"] = str(config.options.get("model") or "")
        info.add_metric(labels, said | texts.get(drive.name, {}))
        if drive.status is not None and not drive.late:
            state.add_metric(labels, {each.value: each is drive.status.state for each in Motion})
            fault.add_metric(labels, drive.status.fault)
        if drive.drift.changed is not None:
            changed.add_metric(labels, drive.drift.changed)
            replaced.add_metric(labels, bool(drive.drift.replaced))
        if drive.reply_s:
            reply.add_metric(labels, drive.reply_s)
    yield from (up, info, state, fault, changed, replaced, reply)


def _of_counters(drives: Iterable[DriveSnapshot]) -> Iterable[Metric]:
    for name, about in COUNTERS.items():
        family = CounterMetricFamily(
            f"drivecomm_{name.replace(' ', '_')}", f"{about[0].upper()}{about[1:]}.", labels=_DRIVE
        )
        for drive in drives:
            if name in drive.counters:
                family.add_metric([drive.line, drive.name], drive.counters[name])
        yield family


def _of_values(lines: Mapping[str, str], values: Iterable[CurrentValue]) -> Iterable[Metric]:
    families: dict[str, GaugeMetricFamily | CounterMetricFamily] = {}
    others = GaugeMetricFamily(
        "drivecomm_parameter", "A parameter that has no common name.", labels=[*_DRIVE, "parameter", "unit"]
    )
    times = GaugeMetricFamily(
        "drivecomm_sample_timestamp_seconds", "When the reply with a value had arrived.", labels=[*_DRIVE, "name"]
    )
    for value in values:
        reading = value.reading
        if reading is None or isinstance(reading.value, str):
            continue
        labels = [lines[value.drive], value.drive]
        known = names().get(value.name)
        if known is None:
            others.add_metric([*labels, value.name, reading.unit], float(reading.value))
        elif reading.unit == quantities()[value.name].unit:
            family = families.get(known.metric) or families.setdefault(known.metric, known.family())
            family.add_metric(labels, float(reading.value) * known.factor)
        times.add_metric([*labels, value.name], reading.time_s)
    yield from families.values()
    yield from (others, times)


def _of_qualities(lines: Mapping[str, str], qualities: Iterable[tuple[CurrentValue, ResultQuality]]) -> Metric:
    family = GaugeMetricFamily(
        "drivecomm_sample_quality",
        "1, by the quality of each value: good, uncertain, stale or bad.",
        labels=[*_DRIVE, "name", "quality"],
    )
    for value, quality in qualities:
        family.add_metric([lines[value.drive], value.drive, value.name, quality], 1)
    return family


def _of_notes(lines: Mapping[str, str], values: Iterable[CurrentValue]) -> Metric:
    family = InfoMetricFamily(
        "drivecomm_sample",
        "How sure type and unit of a value are, if no document prints them.",
        labels=[*_DRIVE, "name"],
    )
    for value in values:
        if value.reading is not None and value.reading.note:
            family.add_metric([lines[value.drive], value.drive, value.name], {"note": value.reading.note})
    return family


class Metrics:
    """Renderer of the metrics of a plant; slow for a large plant."""

    def __init__(self, plant: ServedPlant, door: str, streams: Streams) -> None:
        self._registry = CollectorRegistry(auto_describe=False)
        self._registry.register(PlantCollector(plant, door, streams))
        ProcessCollector(registry=self._registry)

    def rendered(self, accept: str) -> tuple[bytes, str]:
        """Return the metrics and their content type in the format that the Accept header prefers."""
        encoder, content_type = choose_encoder(accept)
        return encoder(self._registry), content_type
