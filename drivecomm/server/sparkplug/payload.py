"""A Sparkplug B payload as values that do not change, and as bytes.

What comes from a network is read within limits, and what cannot be read is a UsageError: a host may send anything.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

from drivecomm.errors import UsageError
from drivecomm.server.sparkplug.wire import payload_class

if TYPE_CHECKING:
    from collections.abc import Mapping

MOST_BYTES = 64 * 1024
"""A command is no longer; one that is would be read for nothing."""
MOST_METRICS = 100
"""A command holds no more of them: a host writes one, or a handful."""

Scalar: TypeAlias = bool | int | float | str


class DataType(IntEnum):
    """What a metric or a property holds, by the specification's numbers."""

    INT8 = 1
    INT16 = 2
    INT32 = 3
    INT64 = 4
    UINT8 = 5
    UINT16 = 6
    UINT32 = 7
    UINT64 = 8
    FLOAT = 9
    DOUBLE = 10
    BOOLEAN = 11
    STRING = 12
    DATETIME = 13
    TEXT = 14
    UUID = 15


_KNOWN = frozenset(DataType)
_BITS = {
    DataType.INT8: 8, DataType.INT16: 16, DataType.INT32: 32, DataType.INT64: 64,
    DataType.UINT8: 8, DataType.UINT16: 16, DataType.UINT32: 32, DataType.UINT64: 64, DataType.DATETIME: 64,
}  # fmt: skip
_FIELDS = {
    **{kind: "long_value" if bits == 64 else "int_value" for kind, bits in _BITS.items()},
    DataType.FLOAT: "float_value",
    DataType.DOUBLE: "double_value",
    DataType.BOOLEAN: "boolean_value",
    **dict.fromkeys((DataType.STRING, DataType.TEXT, DataType.UUID), "string_value"),
}
_SIGNED = frozenset({DataType.INT8, DataType.INT16, DataType.INT32, DataType.INT64})
_NO_PROPERTIES: Mapping[str, Property] = MappingProxyType({})
_MOST_PROPERTIES = 512
"""Sets of properties that are kept as they are written; a plant has few of them."""


class Property(NamedTuple):
    """What is said of a metric, such as its quality or its unit. type: of value."""

    type: DataType
    value: Scalar


class Metric(NamedTuple):
    """One metric of a payload; a tuple, because so many are made.

    name, alias: either, or both in a birth. time_ms: when the value was true, in milliseconds since 1970. type: of
    value; None where the payload does not say it, because the birth did. value: None for a metric that has none now.
    is_historical: it was true at its time, and something later is known.
    """

    name: str = ""
    alias: int | None = None
    time_ms: int | None = None
    type: DataType | None = None
    value: Scalar | None = None
    is_historical: bool = False
    properties: Mapping[str, Property] = _NO_PROPERTIES


@dataclass(frozen=True, slots=True, kw_only=True)
class Payload:
    """A message's content. time_ms: when it was sent. seq: None for those that carry none. uuid: empty without one."""

    metrics: tuple[Metric, ...] = ()
    time_ms: int | None = None
    seq: int | None = None
    uuid: str = ""


def encoded(payload: Payload, *, say_types: bool) -> bytes:
    """Return a payload as bytes. say_types: each metric tells its type, as in births; else only its alias does."""
    message = payload_class()()
    if payload.time_ms is not None:
        message.timestamp = payload.time_ms
    if payload.seq is not None:
        message.seq = payload.seq
    if payload.uuid:
        message.uuid = payload.uuid
    for metric in payload.metrics:
        _put_metric(message.metrics.add(), metric, say_type=say_types)
    return bytes(message.SerializeToString())


def _put_metric(message: Any, metric: Metric, *, say_type: bool) -> None:
    if metric.name:
        message.name = metric.name
    if metric.alias is not None:
        message.alias = metric.alias
    if metric.time_ms is not None:
        message.timestamp = metric.time_ms
    if say_type and metric.type is not None:
        message.datatype = metric.type
    if metric.is_historical:
        message.is_historical = True
    if metric.properties:
        message.properties.CopyFrom(_written(tuple(metric.properties.items())))
    if metric.value is None or metric.type is None:
        message.is_null = True
    else:
        setattr(message, _FIELDS[metric.type], _bits_of(metric.value, metric.type))


@lru_cache(_MOST_PROPERTIES)
def _written(properties: tuple[tuple[str, Property], ...]) -> Any:
    """Return a set of properties as the payload holds it; to be copied from only."""
    found = payload_class()().metrics.add().properties
    for key, each in properties:
        found.keys.append(key)
        value = found.values.add(type=each.type)
        setattr(value, _FIELDS[each.type], _bits_of(each.value, each.type))
    return found


def _bits_of(value: Scalar, kind: DataType) -> Scalar:
    """Return a value as its field holds it: negative whole numbers as what their bits are without a sign."""
    bits = _BITS.get(kind)
    if bits is None:
        return value
    # The field of small ones is 32 bits wide, and so is their sign.
    return int(value) & ((1 << max(bits, 32)) - 1)


def decoded(data: bytes) -> Payload:
    """Return what bytes from a network say. Raises UsageError for those that are no payload, or too large a one.

    Values that the metric does not name the type of, or names a wrong one, are as their field holds them; see `typed`.
    """
    if len(data) > MOST_BYTES:
        raise UsageError(f"the payload has {len(data)} bytes; send at most {MOST_BYTES}")
    from google.protobuf.message import DecodeError

    try:
        message = payload_class().FromString(data)
    except (DecodeError, ValueError) as error:
        raise UsageError("the payload is no Sparkplug B payload") from error
    if len(message.metrics) > MOST_METRICS:
        raise UsageError(f"the payload has {len(message.metrics)} metrics; send at most {MOST_METRICS}")
    return Payload(
        metrics=tuple(_metric(each) for each in message.metrics),
        time_ms=message.timestamp if message.HasField("timestamp") else None,
        seq=message.seq if message.HasField("seq") else None,
        uuid=message.uuid,
    )


def _metric(message: Any) -> Metric:
    kind = DataType(message.datatype) if message.datatype in _KNOWN else None
    metric = Metric(
        name=message.name,
        alias=message.alias if message.HasField("alias") else None,
        time_ms=message.timestamp if message.HasField("timestamp") else None,
        type=kind,
        value=_value(message),
        is_historical=message.is_historical,
        properties={
            key: Property(type=DataType(each.type), value=_signed(_value(each), DataType(each.type)))
            for key, each in zip(message.properties.keys, message.properties.values, strict=False)
            if each.type in _KNOWN and _value(each) is not None
        },
    )
    if kind is None:
        return metric
    try:
        return typed(metric, kind)
    except UsageError:
        # Whoever needs it refuses it; it takes nothing that stands beside it along.
        return metric


def _value(message: Any) -> Any:
    which = message.WhichOneof("value")
    return None if which is None or message.is_null or which == "bytes_value" else getattr(message, which)


def typed(metric: Metric, kind: DataType) -> Metric:
    """Return a metric with a value of the type that its birth has said. Raises UsageError for another value."""
    value = metric.value
    if value is None:
        return metric._replace(type=kind)
    if isinstance(value, _PYTHON[_FIELDS[kind]]) and isinstance(value, bool) == (kind is DataType.BOOLEAN):
        return metric._replace(type=kind, value=_signed(value, kind))
    raise UsageError(f"{metric.name or metric.alias} takes a {kind.name.lower()}, not {value!r:.60}")


_PYTHON: dict[str, tuple[type, ...]] = {
    "int_value": (int,),
    "long_value": (int,),
    "float_value": (int, float),
    "double_value": (int, float),
    "boolean_value": (bool,),
    "string_value": (str,),
}


def _signed(value: Any, kind: DataType) -> Any:
    if kind not in _SIGNED or not isinstance(value, int) or value < 0:
        return value
    bits = _BITS[kind]
    value &= (1 << bits) - 1
    return value - (1 << bits) if value >> (bits - 1) else value
