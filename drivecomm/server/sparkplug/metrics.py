"""A drive as metrics: values, state, properties and commands, the same in births and in data.

Sparkplug has three quality codes, none of which expresses doubts of the model: a property of our own does, and the
value is good. A doubtful reading, however, is not good and counts as stale here.
"""

from __future__ import annotations

from functools import lru_cache
from math import isfinite
from types import MappingProxyType
from typing import TYPE_CHECKING

from drivecomm.line import FRESH, STATUS
from drivecomm.models import TEXT_QUANTITIES, quantities
from drivecomm.server import CurrentValue
from drivecomm.server.sparkplug.payload import DataType, Metric, Property, Scalar

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping
    from decimal import Decimal

    from drivecomm.line import ResultQuality
    from drivecomm.protocol import DriveConfig, DriveStatus, Value
    from drivecomm.server import CommandAnswer, CommandRequest, DriveSnapshot, PastValue

VALUES = "Values/"
QUALITY, UNCERTAIN, REASON = "Quality", "Uncertain", "Reason"
"""Properties. The second and third are our own: whether the meaning of a value is in doubt, and why."""

_CODES: Mapping[ResultQuality, int] = {"good": 192, "uncertain": 500, "stale": 500, "bad": 0}
_LONGEST_TEXT = 500
_LARGEST = 2**63
_MOST_REASONS = 256

_OF_STATUS: Mapping[str, tuple[DataType, Callable[[DriveStatus], Scalar | None]]] = {
    "Status/State": (DataType.STRING, lambda status: status.state.value),
    # Decoders disagree on the field of a UInt32, but not on that of an Int64.
    "Status/Word": (DataType.INT64, lambda status: status.word),
    "Status/Running": (DataType.BOOLEAN, lambda status: status.running),
    "Status/Fault": (DataType.BOOLEAN, lambda status: status.fault),
    "Status/Fault Code": (DataType.INT64, lambda status: status.fault_code),
    "Status/Fault Text": (DataType.STRING, lambda status: status.fault_text),
    "Status/Warning": (DataType.BOOLEAN, lambda status: status.warning),
    "Status/At Reference": (DataType.BOOLEAN, lambda status: status.at_reference),
    "Status/Reverse": (DataType.BOOLEAN, lambda status: status.reverse),
}
_ANSWERS = ("Answer/Command", "Answer/Outcome", "Answer/Text", "Answer/Id")


@lru_cache(_MOST_REASONS)
def quality_properties(quality: ResultQuality, reason: str = "") -> Mapping[str, Property]:
    """Return the properties for a quality. reason: remark on the value, which marks a fresh value as uncertain."""
    said = {
        QUALITY: Property(type=DataType.INT32, value=_CODES[quality]),
        UNCERTAIN: Property(type=DataType.BOOLEAN, value=quality in FRESH and bool(reason)),
    }
    if reason:
        said[REASON] = Property(type=DataType.STRING, value=reason[:_LONGEST_TEXT])
    return MappingProxyType(said)


def metrics_of_value(value: CurrentValue, state: DriveSnapshot, quality: ResultQuality, time_s: float) -> list[Metric]:
    """Return the metrics of a current value, several for a status. time_s: time at which its quality was determined."""
    said = quality_properties(quality, value.remark)
    fresh = value.reading is not None and quality in FRESH
    time_ms = milliseconds(value.reading.time_s if value.reading is not None and fresh else time_s)
    if value.name == STATUS:
        status = state.status if quality != "bad" else None
        return [
            Metric(name=name, type=kind, time_ms=time_ms, value=None if status is None else of(status), properties=said)
            for name, (kind, of) in _OF_STATUS.items()
        ]
    reading = None if quality == "bad" else value.reading
    kind, number = typed_value(value.name, None if reading is None else reading.value)
    return [Metric(name=VALUES + value.name, type=kind, time_ms=time_ms, value=number, properties=said)]


def metrics_of_past(value: PastValue) -> list[Metric]:
    """Return the metrics of a past value, marked as historical; for a status, those of state and status word."""
    said, time_ms = quality_properties(value.quality, value.note), milliseconds(value.time_s)
    known = None if value.quality == "bad" else value.value
    found: Mapping[str, tuple[DataType, Scalar | None]] = {VALUES + value.name: typed_value(value.name, known)}
    if value.name == STATUS:
        word = value.raw if isinstance(value.raw, int) and known is not None else None
        state = None if known is None else str(known)
        found = {"Status/State": (DataType.STRING, state), "Status/Word": (DataType.INT64, word)}
    return [
        Metric(name=name, type=kind, time_ms=time_ms, value=number, is_historical=True, properties=said)
        for name, (kind, number) in found.items()
    ]


def typed_value(name: str, value: Value | None) -> tuple[DataType, Scalar | None]:
    """Return type and content of a metric; all numbers are doubles, so that the type never changes."""
    if isinstance(value, str):
        return DataType.STRING, value[:_LONGEST_TEXT]
    kind = DataType.STRING if name in TEXT_QUANTITIES else DataType.DOUBLE
    if value is None:
        return kind, None
    if kind is DataType.STRING:
        return kind, str(value)
    number = float(value)
    return kind, number if isfinite(number) else None


def metrics_of_drive(state: DriveSnapshot, time_ms: int) -> list[Metric]:
    """Return the metrics with the properties of a drive and its commander."""
    config = state.config
    texts = {
        "Properties/Protocol": config.protocol,
        "Properties/Address": str(config.address),
        "Properties/Model": str(config.options.get("model") or ""),
        "Properties/Title": config.title,
        "Properties/Line": state.line,
        **commander_texts(state),
    }
    only_read = Metric(
        name="Properties/Monitoring Only", type=DataType.BOOLEAN, time_ms=time_ms, value=state.monitoring_only
    )
    told = [Metric(name=name, type=DataType.STRING, time_ms=time_ms, value=text) for name, text in texts.items()]
    return [*told, only_read]


def commander_texts(state: DriveSnapshot) -> dict[str, str]:
    """Return texts for the commander of a drive, the policy of its kept motor, its standing stop, and its drift."""
    return {
        "Status/Commander": "" if state.lease is None else str(state.lease.holder),
        "Status/Kept": state.kept,
        "Status/Standing Stop": str(state.standing_stop or ""),
        "Status/Drift": str(state.drift)[:_LONGEST_TEXT],
    }


def metrics_of_answer(
    command: CommandRequest | None, answer: CommandAnswer | None, text: str, time_ms: int
) -> list[Metric]:
    """Return the metrics with the outcome of a drive's last command, without values before the first command."""
    said: Iterable[str | None] = (None,) * len(_ANSWERS)
    if command is not None and answer is not None:
        said = (command.verb, answer.outcome, text[:_LONGEST_TEXT], command.id)
    return [
        Metric(name=name, type=DataType.STRING, time_ms=time_ms, value=each)
        for name, each in zip(_ANSWERS, said, strict=True)
    ]


def unread(drive: DriveConfig, time_s: float) -> dict[str, CurrentValue]:
    """Return placeholders for polled values before their first reading: a birth must list all metrics."""
    names = [STATUS, *(name for group in drive.poll for name in group.parameters)]
    return {
        name: CurrentValue(
            drive=drive.name, name=name, reading=None, quality="bad", cause="was not read yet", time_s=time_s
        )
        for name in names
    }


def with_unit(metric: Metric, unit: str, limits: tuple[Decimal | None, Decimal | None]) -> Metric:
    """Return a metric with properties for its unit and limits, as in a birth."""
    more = {"engUnit": Property(type=DataType.STRING, value=unit)} if unit else {}
    for key, limit in zip(("engLow", "engHigh"), limits, strict=True):
        if limit is not None:
            more[key] = Property(type=DataType.DOUBLE, value=float(limit))
    return metric._replace(properties={**metric.properties, **more}) if more else metric


def unit_of(value: CurrentValue) -> str:
    """Return the unit of a value; before the first reading, that of its common name."""
    if value.reading is not None:
        return value.reading.unit
    known = quantities().get(value.name)
    return known.unit if known else ""


def same(one: Metric, other: Metric) -> bool:
    """Whether two metrics have equal values and qualities. Times do not count: an equal metric is not sent again."""
    if one.value != other.value:
        return False
    ours, theirs = one.properties, other.properties
    return ours is theirs or all(ours.get(key) == theirs.get(key) for key in (QUALITY, UNCERTAIN))


def milliseconds(time_s: float) -> int:
    """Return a time in milliseconds since 1970."""
    return max(0, min(round(time_s * 1000), _LARGEST))
