"""Payloads as bytes: written by hand from the specification's field numbers, round trips, and random input."""

import math

import pytest
from hypothesis import given, strategies as st

from drivecomm.errors import UsageError
from drivecomm.server.sparkplug.payload import (
    MOST_BYTES,
    MOST_METRICS,
    DataType,
    Metric,
    Payload,
    Property,
    decode_payload,
    encode_payload,
    typed,
)

# Tag byte = field number * 8 + wire type (0 varint, 1 eight bytes, 2 length-prefixed, 5 four bytes), then the value.
DEATH = bytes.fromhex(
    "08 e807"  # 1 timestamp: 1000
    "12 0b"  # 2 metrics: 11 bytes
    "0a 05 6264536571"  # . 1 name: bdSeq
    "20 04"  # . 4 datatype: Int64
    "58 05"  # . 11 long_value: 5
)
DATA = bytes.fromhex(
    "08 01"  # 1 timestamp: 1
    "12 2c"  # 2 metrics: 44 bytes
    "10 07"  # . 2 alias: 7
    "18 02"  # . 3 timestamp: 2
    "28 01"  # . 5 is_historical
    "4a 1b"  # . 9 properties: 27 bytes
    "0a 07 5175616c697479"  # . . 1 keys: Quality
    "0a 03 4c6f77"  # . . 1 keys: Low
    "12 05 08 03 18 c001"  # . . 2 values: 1 type: Int32, 3 int_value: 192
    "12 04 08 0b 38 01"  # . . 2 values: 1 type: Boolean, 7 boolean_value: true
    "69 0000000000002940"  # . 13 double_value: 12.5
    "18 ff01"  # 3 seq: 255
)


def test_encoded_death_matches_the_wire_format():
    payload = Payload(time_ms=1000, metrics=(Metric(name="bdSeq", type=DataType.INT64, value=5),))
    assert encode_payload(payload, say_types=True) == DEATH
    assert decode_payload(DEATH) == payload


def test_encoded_data_has_no_type_and_no_name():
    said = {
        "Quality": Property(type=DataType.INT32, value=192),
        "Low": Property(type=DataType.BOOLEAN, value=True),
    }
    metric = Metric(alias=7, time_ms=2, type=DataType.DOUBLE, value=12.5, is_historical=True, properties=said)
    payload = Payload(time_ms=1, seq=255, metrics=(metric,))
    assert encode_payload(payload, say_types=False) == DATA
    found = decode_payload(DATA).metrics[0]
    assert found.type is None
    assert typed(found, DataType.DOUBLE) == metric


TEXTS = st.text(alphabet="aZ/ é漢", max_size=10)


def values(kind):
    name = kind.name
    if "INT" in name:
        bits = int(name[-2:]) if name[-2:].isdigit() else 8
        return st.integers(0, 2**bits - 1) if name[0] == "U" else st.integers(-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    return {
        "FLOAT": st.floats(width=32, allow_nan=False),
        "DOUBLE": st.floats(allow_nan=False),
        "BOOLEAN": st.booleans(),
        "DATETIME": st.integers(0, 2**63),
    }.get(name, TEXTS)


@st.composite
def metrics(draw):
    kind = draw(st.sampled_from(DataType))
    return Metric(
        name=draw(TEXTS),
        alias=draw(st.none() | st.integers(0, 2**64 - 1)),
        time_ms=draw(st.none() | st.integers(0, 2**63)),
        type=kind,
        value=draw(st.none() | values(kind)),
        is_historical=draw(st.booleans()),
    )


@pytest.mark.soak
@given(st.lists(metrics(), max_size=5), st.none() | st.integers(0, 255))
def test_payload_survives_encoding_and_decoding(said, seq):
    payload = Payload(metrics=tuple(said), time_ms=5, seq=seq)
    assert decode_payload(encode_payload(payload, say_types=True)) == payload


@given(st.binary(max_size=200) | st.builds(lambda at, by: DATA[:at] + by + DATA[at:], st.integers(0, 60), st.binary()))
def test_any_bytes_give_a_payload_or_a_usage_error(data):
    try:
        payload = decode_payload(data)
    except UsageError:
        return
    for metric in payload.metrics:
        for kind in DataType:
            try:
                found = typed(metric, kind).value
            except UsageError:
                continue
            assert found is None or isinstance(found, bool) == (kind is DataType.BOOLEAN)


def test_payload_with_too_many_bytes_or_metrics_is_refused():
    with pytest.raises(UsageError, match=f"send at most {MOST_BYTES}"):
        decode_payload(bytes(MOST_BYTES + 1))
    with pytest.raises(UsageError, match=f"send at most {MOST_METRICS}"):
        decode_payload(b"\x12\x00" * (MOST_METRICS + 1))


def test_infinite_value_is_decoded_unchanged():
    metric = Metric(name="x", type=DataType.DOUBLE, value=math.inf)
    assert decode_payload(encode_payload(Payload(metrics=(metric,)), say_types=True)).metrics == (metric,)
