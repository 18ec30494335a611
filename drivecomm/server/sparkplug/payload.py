"""A Sparkplug B payload as immutable values, and its encoding.

Received payloads are decoded within limits. Unreadable ones raise UsageError, because a host may send anything.
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
"""Maximum bytes of a received payload, far above any command."""
MOST_METRICS = 100
"""Maximum metrics of a received payload: a host writes one or a few."""

Scalar: TypeAlias = bool | int | float | str


class DataType(IntEnum):
    """Types of metrics and properties, with the numbers of the specification."""

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
"""Number of cached encoded property sets; a plant has few different ones."""


class Property(NamedTuple):
    """Property of a metric, such as its quality or its unit. type: type of the value."""

    type: DataType
    value: Scalar


class Metric(NamedTuple):
    """Metric of a payload; a tuple for speed, because very many are created.

    name, alias: one of them, or both in a birth. time_ms: time of the value in milliseconds since 1970. type: type of
    the value; None if only the birth contains it. value: None for a metric without a present value. is_historical:
    whether a later value is known.
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
    """Content of a message. time_ms: when it was sent. seq: None if it has no number. uuid: "" if it has none."""

    metrics: tuple[Metric, ...] = ()
    time_ms: int | None = None
    seq: int | None = None
    uuid: str = ""


def encode_payload(payload: Payload, *, say_types: bool) -> bytes:
    """Return the bytes of a payload. say_types: whether each metric contains its type, as in births."""
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
    """Return a property set as protobuf object, which is shared and only to be copied."""
    found = payload_class()().metrics.add().properties
    for key, each in properties:
        found.keys.append(key)
        value = found.values.add(type=each.type)
        setattr(value, _FIELDS[each.type], _bits_of(each.value, each.type))
    return found


def _bits_of(value: Scalar, kind: DataType) -> Scalar:
    """Return a value in the form of its field: negative integers as two's complement."""
    bits = _BITS.get(kind)
    if bits is None:
        return value
    # Small integers have a 32-bit field and are sign-extended to it.
    return int(value) & ((1 << max(bits, 32)) - 1)


def decode_payload(data: bytes) -> Payload:
    """Return the payload in received bytes. Raises UsageError if it is invalid or too large.

    A value without a type, or with a wrong one, keeps the form of its field; see `typed`.
    """
    if len(data) > MOST_BYTES:
        raise UsageError(f"the payload has {len(data)} bytes; send at most {MOST_BYTES}")
    from google.protobuf.message import DecodeError

    try:
        message = payload_class().FromString(data)
    except (DecodeError, ValueError) as error:
        raise UsageError("the payload is not a Sparkplug B payload") from error
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
        # Keep a mistyped metric: its reader rejects it, and the others in the payload survive.
        return metric


def _value(message: Any) -> Any:
    which = message.WhichOneof("value")
    return None if which is None or message.is_null or which == "bytes_value" else getattr(message, which)


def typed(metric: Metric, kind: DataType) -> Metric:
    """Return a metric with its value converted to the type in its birth. Raises UsageError if it does not fit."""
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
