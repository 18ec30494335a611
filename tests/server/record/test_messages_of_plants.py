"""Messages of MQTT doors as records, and refusal of content that databases cannot store."""

import json

import pytest

from drivecomm.errors import UsageError
from drivecomm.server.mqtt.content import PublishedValue as Published, named_text, value_text
from drivecomm.server.record.layout import Layout
from drivecomm.server.record.messages import (
    PlantState,
    RecordedCommand,
    RecordedEvent,
    RecordedSample,
    StandingAlarms,
    records_in,
)

UNFIT = (ValueError, TypeError, KeyError, AttributeError, ArithmeticError, RecursionError)
FREQUENCY = '{"value":12.50,"unit":"Hz","quality":"good","time_s":1795375957.921}'


def records(topic, payload, *levels):
    payload = payload if isinstance(payload, str) else json.dumps(payload)
    return list(records_in(Layout("drivecomm", levels or ("plant",)), topic, payload.encode()))


def test_recorded_value_keeps_its_digits_and_time():
    (found,) = records("drivecomm/Mill%20north/fan/output_frequency", FREQUENCY)
    assert found == RecordedSample(
        "Mill north", "fan", "output_frequency", 1795375957921, "12.50", None, "Hz", "good", "", "", None
    )


def test_message_with_all_values_of_a_drive_gives_one_record_each():
    status = (
        '{"value":"fault","quality":"stale","text":"F1","note":"silent","time_s":1795375957.921,'
        '"source_s":1795375950.0}'
    )
    said = f'{{"output_frequency":{FREQUENCY},"status":{status}}}'
    first, second = records("drivecomm/hall/fan/values", said)
    assert (first.name, first.number) == ("output_frequency", "12.50")
    assert (second.name, second.number, second.string) == ("status", None, "fault")
    assert (second.quality, second.text, second.note, second.source_ms) == ("stale", "F1", "silent", 1795375950000)


def test_live_and_historical_values_have_the_same_key_and_content():
    published = Published("fan", "16-30.1", 7, "A", "seven", "uncertain", "derived", 1795375957921, None)
    (live,) = records("drivecomm/hall/fan/16-30.1", value_text(published))
    (late,) = records("drivecomm/hall/bridge/historical", f'{{"values":[{named_text(published)}]}}')
    assert live == late


def test_events_states_and_commands_of_a_plant_are_recorded():
    (event,) = records(
        "drivecomm/hall/bridge/event", {"number": 3, "time_s": 17, "kind": "fault", "text": "x", "drive": "fan"}
    )
    assert event == RecordedEvent("hall", 17000, 3, "fault", "x", "fan", "", "", "")
    (state,) = records("drivecomm/hall/bridge/state", {"state": "online", "version": "1.2", "session": "s"})
    assert state == PlantState("hall", state="online", version="1.2")
    file = {"name": "plant.toml", "sha256": "ab", "read_s": 1.5}
    (info,) = records("drivecomm/hall/bridge/info", {"version": "1.2", "file": file, "drives": []})
    assert (info.file, info.file_sha256, info.file_read_ms) == ("plant.toml", "ab", 1500)
    alarm = {"id": "a-1", "rule": "tripped", "drive": "fan", "text": "fault", "since_s": 2, "over_s": None}
    (standing,) = records("drivecomm/hall/bridge/alarms", {"alarms": [alarm]})
    assert isinstance(standing, StandingAlarms)
    assert standing.alarms[0][:5] == ("a-1", "tripped", "fan", "fault", 2000)
    command = {"row": 4, "time_s": 1, "done_s": 2, "who": "otto", "verb": "start", "drive": "fan", "outcome": "done"}
    (done,) = records("drivecomm/hall/bridge/audit", {"commands": [{**command, "arguments": {"percent": 40}}]})
    assert isinstance(done, RecordedCommand)
    assert (done.row, done.who, done.arguments) == (4, "otto", '{"percent":40}')


@pytest.mark.parametrize(
    "topic",
    ["fan/command", "fan/stop", "fan/lease", "fan/response", "fan/availability", "bridge/holder", "fan", "a/b/c"],
)
def test_other_topics_are_not_recorded(topic):
    assert records(f"drivecomm/hall/{topic}", {"token": "secret"}) == []
    assert records(f"works/hall/{topic}", {"token": "secret"}) == []


@pytest.mark.parametrize(
    ("levels", "above", "line", "plant"),
    [
        (("line",), "hall", "/l1", "hall"),
        (("site", "area"), "Leeds/mixing", "", "Leeds/mixing"),
        (("site", "area", "line"), "Leeds/mixing", "/l1", "Leeds/mixing"),
        (("enterprise", "plant"), "Acme%2FCo/hall", "", "Acme%2FCo/hall"),
    ],
)
def test_plant_with_topic_levels_is_recorded_by_its_levels(levels, above, line, plant):
    (found,) = records(f"drivecomm/{above}{line}/fan/output_frequency", FREQUENCY, *levels)
    assert (found.plant, found.drive, found.name) == (plant, "fan", "output_frequency")
    (state,) = records(f"drivecomm/{above}/bridge/state", {"state": "online"}, *levels)
    assert state.plant == plant
    assert records(f"drivecomm/{above}/deeper{line}/fan/output_frequency", FREQUENCY, *levels) == []


@pytest.mark.parametrize("levels", [("floor",), ("line", "site"), ("site", "site"), ()])
def test_invalid_topic_levels_are_refused(levels):
    with pytest.raises(UsageError, match="level"):
        Layout("drivecomm", levels)


def test_cleared_topic_gives_no_record():
    assert records("drivecomm/hall/fan/output_frequency", "") == []


@pytest.mark.parametrize(
    "said",
    [
        "[1]", "nothing", '{"quality":"good","time_s":1}', '{"value":true,"quality":"good","time_s":1}',
        '{"value":1e999999,"quality":"good","time_s":1}', f'{{"value":{"9" * 400},"quality":"good","time_s":1}}',
        f'{{"value":{"9" * 5000},"quality":"good","time_s":1}}', '{"value":NaN,"quality":"good","time_s":1}',
        '{"value":1,"quality":"good","time_s":1e30}', '{"value":1,"quality":"good","time_s":-1}',
        '{"value":1,"quality":"good","time_s":"now"}', '{"value":1,"quality":3,"time_s":1}',
        '{"value":1,"quality":"good","time_s":1e999999999}',
    ],
)  # fmt: skip
def test_value_that_a_database_cannot_store_is_refused(said):
    with pytest.raises(UNFIT):
        records("drivecomm/hall/fan/speed", said)


def test_characters_that_postgresql_refuses_are_replaced_in_texts():
    (found,) = records("drivecomm/hall/fan/name", '{"value":"a\\u0000b\\ud800","quality":"good","time_s":1}')
    assert found.string == "a\ufffdb?"
