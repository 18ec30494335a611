"""Values as JSON messages: exact decimals, unit, quality and time. No I/O."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

from drivecomm.client import json_text, parsed
from drivecomm.line import FRESH

if TYPE_CHECKING:
    from drivecomm.line import ResultQuality
    from drivecomm.protocol import MachineValue, Value
    from drivecomm.server import CurrentValue, PastValue

REPEATED = ',"repeated":true}'
"""End of the JSON of a value that was published before."""

_LARGEST = 4 * 1024 * 1024
"""Maximum bytes of a message of another plant; larger ones are not parsed."""


def object_in(payload: bytes) -> dict[str, Any]:
    """Return the JSON object in a message of another plant. Raises ValueError or TypeError for anything else."""
    if len(payload) > _LARGEST:
        raise ValueError("too large")
    content = parsed(payload)
    if not isinstance(content, dict):
        raise TypeError("no object")
    return content


class PublishedValue(NamedTuple):
    """Value of a quantity at one time, or its absence. Times are in ms since 1970, as in the history.

    time_ms: arrival of the reply; for a stale or bad value, the time when this was detected. source_ms: for a stale
    value, the time when it was read. machine: speed of the machine for a frequency; None for values of the history.
    """

    drive: str
    name: str
    value: Value | None
    unit: str
    text: str
    quality: ResultQuality
    note: str
    time_ms: int
    source_ms: int | None = None
    machine: MachineValue | None = None


def sample_of(value: CurrentValue) -> PublishedValue:
    """Return a current value as a sample."""
    reading, quality, time_ms = value.reading, value.quality, round(value.time_s * 1000)
    if reading is None:
        return PublishedValue(value.drive, value.name, None, "", "", quality, value.cause, time_ms)
    read_ms = round(reading.time_s * 1000)
    at_ms, source_ms = (read_ms, None) if quality in FRESH else (time_ms, read_ms)
    return PublishedValue(
        value.drive,
        value.name,
        reading.value,
        reading.unit,
        reading.text,
        quality,
        value.remark,
        at_ms,
        source_ms,
        value.at_machine,
    )


def past_sample(value: PastValue) -> PublishedValue:
    """Return a value of the history as a sample."""
    return PublishedValue(
        value.drive,
        value.name,
        value.value,
        value.unit,
        value.text,
        value.quality,
        value.note,
        round(value.time_s * 1000),
        None if value.source_s is None else round(value.source_s * 1000),
    )


def value_text(sample: PublishedValue) -> str:
    """Return the JSON of a value for its own topic."""
    return f'{{"value":{json_text(sample.value)}{_end(sample)}'


def named_text(sample: PublishedValue) -> str:
    """Return the JSON of a value with its drive and name."""
    return f'{_begin(sample.drive, sample.name)}"value":{json_text(sample.value)}{_end(sample)}'


def repeated(text: str) -> str:
    """Return the JSON of a value, marked as published before."""
    return text[:-1] + REPEATED


def _end(sample: PublishedValue) -> str:
    said = _said(sample.unit, sample.quality, sample.text, sample.note)
    source = "" if sample.source_ms is None else f',"source_s":{_seconds(sample.source_ms)}'
    if sample.machine is not None:
        said += f',"machine_value":{json_text(sample.machine.value)},"machine_unit":{json_text(sample.machine.unit)}'
    return f'{said},"time_s":{_seconds(sample.time_ms)}{source}}}'


def _seconds(time_ms: int) -> str:
    return f"{time_ms // 1000}.{time_ms % 1000:03d}"


@lru_cache(maxsize=4096)
def _begin(drive: str, name: str) -> str:
    return f'{{"drive":{json_text(drive)},"name":{json_text(name)},'


@lru_cache(maxsize=4096)
def _said(unit: str, quality: str, text: str, note: str) -> str:
    content = {"unit": unit, "quality": quality}
    content |= {key: each for key, each in (("text", text), ("note", note)) if each}
    return f",{json_text(content)[1:-1]}"
