"""Topics, the text of values, delivered values, and the rate limit of messages."""

from dataclasses import replace
from decimal import Decimal

import pytest

from drivecomm.client import parsed
from drivecomm.errors import FileFormatError
from drivecomm.protocol import MachineUnit, Reading
from drivecomm.server import CurrentValue, Role
from drivecomm.server.mqtt.changes import ChangeRules
from drivecomm.server.mqtt.content import named_text, repeated, sample_of, value_text
from drivecomm.server.mqtt.delivered import LiveValues, Position, read_position, write_position
from drivecomm.server.mqtt.rate_limit import A_SECOND, AT_ONCE, RateLimit
from drivecomm.server.mqtt.settings import mqtt_settings
from drivecomm.server.mqtt.topics import Topics, level, name_of
from drivecomm.tomlfile import TomlTable

NOON = 1_795_000_000.0


def value(number="12.50", *, drive="pump", name="output_frequency", quality="good", cause="", at=0.0, **more):
    content = number if name == "status" else Decimal(number)
    reading = Reading(parameter="241", value=content, raw=1, unit="Hz", time_s=NOON + at, **more)
    none = quality == "bad"
    return CurrentValue(drive=drive, name=name, reading=None if none else reading, quality=quality, cause=cause,
                        time_s=NOON + at + 5)  # fmt: skip


def test_each_quantity_has_a_topic():
    topics = Topics("drivecomm/hall 2")
    assert topics.value("pump", "output_frequency") == "drivecomm/hall 2/pump/output_frequency"
    assert topics.value("pump", "16-13") == "drivecomm/hall 2/pump/16-13"
    assert topics.state == "drivecomm/hall 2/bridge/state"


@pytest.mark.parametrize(
    "name", ["a/b", "a+b", "#", "%2F", "Lüfter", "a%", "bridge", "x\x00y", "Bridge", "%62ridge", "Mill north", " "]
)
def test_any_name_is_encoded_as_one_topic_level(name):
    text = level(name)
    assert not set(text) & set("/+# \x00")
    assert text != "bridge"
    assert name_of(text) == name


def test_topics_of_names_are_distinct_from_each_other_and_reserved_topics():
    names = ["a/b", "a%2Fb", "a%252Fb", "values", "%76alues", "command", "stop", "availability", "response", "lease"]
    topics = Topics("p")
    found = {topics.value("d", name) for name in names}
    assert len(found) == len(names)
    own = {topics.values("d"), topics.command("d"), topics.stop("d"), topics.availability("d"), topics.response("d")}
    assert not found & own
    assert topics.drive("bridge") != topics.bridge


def test_frequency_of_a_machine_also_has_its_machine_speed():
    machine = MachineUnit(unit="m/min", per_hz="1.25")
    frequency = replace(value(), machine=machine)
    frequency = replace(frequency, reading=replace(frequency.reading, name="output_frequency"))
    text = value_text(sample_of(frequency))
    assert '"quality":"good","machine_value":15.62,"machine_unit":"m/min","time_s":' in text
    assert "machine" not in value_text(sample_of(replace(frequency, reading=None, quality="bad")))
    other = replace(frequency, reading=replace(frequency.reading, name="mains_frequency"))
    assert "machine" not in value_text(sample_of(other))


def test_value_text_has_digits_unit_quality_and_time():
    assert value_text(sample_of(value())) == '{"value":12.50,"unit":"Hz","quality":"good","time_s":1795000000.000}'
    whole = parsed(value_text(sample_of(value("50"))))
    assert whole["value"] == 50
    noted = parsed(value_text(sample_of(value(quality="uncertain", note='says "so"', at=0.0625))))
    assert (noted["note"], noted["quality"], noted["time_s"]) == ('says "so"', "uncertain", Decimal("1795000000.062"))


def test_missing_or_stale_value_has_its_cause_as_a_note():
    bad = parsed(value_text(sample_of(value(quality="bad", cause="no reply"))))
    assert (bad["value"], bad["note"], bad["time_s"]) == (None, "no reply", NOON + 5)
    stale = parsed(value_text(sample_of(value(quality="stale", cause="no reply"))))
    assert (stale["value"], stale["quality"], stale["source_s"], stale["time_s"]) == (
        Decimal("12.50"),
        "stale",
        NOON,
        NOON + 5,
    )


def test_value_text_may_have_drive_and_repeated_mark():
    text = named_text(sample_of(value(drive='the "big" one')))
    assert parsed(text)["drive"] == 'the "big" one'
    assert parsed(repeated(text))["repeated"] is True


def test_live_value_is_skipped_once_in_the_history():
    live = LiveValues()
    one, two, three = (sample_of(value(at=number)) for number in range(3))
    other = sample_of(value(drive="fan", at=1))
    for each in (one, three, other):
        live.add(each)
    assert [live.take(each) for each in (one, two, three, three)] == [True, False, True, False]
    assert live.take(other)


def test_values_lost_by_the_history_do_not_hide_later_ones():
    live = LiveValues()
    for number in range(5):
        live.add(sample_of(value(at=number)))
    assert [live.take(sample_of(value(at=number))) for number in (3, 4)] == [True, True]


def test_position_file_survives_a_restart(tmp_path):
    file = tmp_path / "new" / "position.json"
    assert read_position(file) is None
    assert write_position(file, Position(7, 1234)) == ""
    assert read_position(file) == Position(7, 1234)
    file.write_text("{")
    assert read_position(file) is None
    assert "cannot be written" in write_position(tmp_path / "new" / "position.json" / "below", Position(7, 1))


def test_rate_limit_admits_an_operator_and_stops_a_flood():
    rate = RateLimit()
    assert all(rate.admits(number / 10) for number in range(1000))
    flood = [rate.admits(100.0 + number / 10_000) for number in range(10_000)]
    assert AT_ONCE <= sum(flood) <= AT_ONCE + A_SECOND + 1
    assert rate.taken() == 10_000 - sum(flood)
    assert rate.taken() == 0
    assert rate.admits(110.0)


def test_mqtt_settings_are_read_from_the_table():
    said = {"broker": "mqtt://127.0.0.1:1", "prefix": "a/b", "role": "operate", "messages": "drives"}
    settings = mqtt_settings(TomlTable(said, "plant.toml"))
    assert (settings.prefix, settings.role, settings.messages) == ("a/b", Role.OPERATE, "drives")
    plain = mqtt_settings(TomlTable({}, "plant.toml"))
    assert (plain.role, plain.changes) == (None, None)
    said = {"publish": "changes", "deadband": {"output_current": 0.1}, "at_least_every_s": 600}
    assert mqtt_settings(TomlTable(said, "plant.toml")).changes == ChangeRules(
        deadbands={"output_current": 0.1}, at_least_every_s=600
    )


@pytest.mark.parametrize(
    ("said", "sentence"),
    [
        ({"prefix": "a/#"}, "invalid prefix = 'a/#'"),
        ({"prefix": "$SYS/x"}, "invalid prefix = "),
        ({"prefix": "/a"}, "no empty level"),
        ({"prefix": ""}, "invalid prefix = ''"),
        ({"home_assistant": "a+"}, "invalid home_assistant = "),
        ({"role": "boss"}, "unknown role 'boss'"),
        ({"messages": "all"}, "invalid messages = 'all'"),
        ({"publish": "all"}, "invalid publish = 'all'"),
        ({"deadband": {"output_current": 0.1}}, 'write publish = "changes" beside it'),
        ({"publish": "changes", "deadband": {"output_current": -1}}, "invalid deadband of output_current: -1"),
        ({"publish": "changes", "deadband": {"output_current": "much"}}, ": 'much'; write a number"),
        ({"publish": "changes", "at_least_every_s": 0.1}, "invalid at_least_every_s = 0.1; write 1 to 86400 seconds"),
        ({"tokens": "x"}, "unknown key 'tokens'"),
    ],
)
def test_invalid_mqtt_setting_is_refused(said, sentence):
    with pytest.raises(FileFormatError) as refused:
        mqtt_settings(TomlTable(said, "plant.toml"))
    assert sentence in str(refused.value)
