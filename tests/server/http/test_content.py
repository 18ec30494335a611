"""JSON of a value, assembled from cached pieces; it equals the JSON of the whole value, field by field."""

from dataclasses import fields, replace
from decimal import Decimal

from hypothesis import given, strategies as st

from drivecomm.client import json_text, parsed, plain
from drivecomm.protocol import MachineUnit, Reading
from drivecomm.server import CurrentValue
from drivecomm.server.http.content import aged, value_head

texts = st.text(max_size=8)
times = st.floats(0, 2e9)
numbers = st.decimals(allow_nan=False, allow_infinity=False) | st.integers()
readings = st.builds(
    Reading, parameter=texts, value=numbers | texts, raw=st.integers() | texts, unit=texts, type=texts, name=texts,
    text=texts, note=texts, time_s=times,
)  # fmt: skip
values = st.builds(
    CurrentValue, drive=texts, name=texts, reading=st.none() | readings,
    quality=st.sampled_from(["good", "uncertain", "stale", "bad"]), cause=texts, time_s=times,
)  # fmt: skip


@given(values)
def test_value_head_equals_the_json_of_the_whole_value(value):
    whole = {
        "drive": value.drive,
        "name": value.name,
        "quality": value.quality,
        "cause": value.cause,
        "time_s": value.time_s,
        "source_s": value.source_s,
        "reading": plain(value.reading),
    }
    assert value_head(value) + "}" == json_text(whole)


def test_value_head_has_every_field_of_a_reading():
    reading = Reading(parameter="1", value=Decimal("5.0"), raw=50)
    said = value_head(CurrentValue(time_s=1.0, drive="pump", name="1", reading=reading, quality="good"))
    assert all(f'"{field.name}":' in said for field in fields(Reading))


def test_frequency_of_a_machine_also_has_its_machine_speed():
    reading = Reading(parameter="1", value=Decimal("10.00"), raw=50, unit="Hz", name="output_frequency")
    belt = MachineUnit(unit="m/min", per_hz="1.25")
    value = CurrentValue(time_s=1.0, drive="belt", name="1", reading=reading, quality="good", machine=belt)
    said = parsed(value_head(value) + "}")
    assert (str(said["machine_value"]), said["machine_unit"]) == ("12.50", "m/min")
    current = replace(value, reading=replace(reading, unit="A", name="output_current"))
    assert "machine" not in value_head(current)
    assert "machine" not in value_head(replace(value, reading=None))


def test_aged_value_has_its_age():
    reading = Reading(parameter="1", value=5, raw=5, time_s=10.0)
    value = CurrentValue(time_s=1.0, drive="pump", name="1", reading=reading, quality="good")
    assert aged(value_head(value), value, 12.5).endswith(',"age_s":2.5}')
