"""Parts of a Sparkplug session without a broker: stored numbers, the host's state, qualities, and settings."""

import json
from decimal import Decimal
from types import SimpleNamespace

import pytest

from drivecomm.errors import FileFormatError, UsageError
from drivecomm.line import FRESH, STATUS
from drivecomm.protocol import DriveConfig, DriveState as Motion, DriveStatus, PollGroup, Reading
from drivecomm.server import Caller, CurrentValue, DriveSnapshot, Lease, LineSnapshot, Role
from drivecomm.server.sparkplug import sparkplug_door
from drivecomm.server.sparkplug.edge_node import EdgeNode
from drivecomm.server.sparkplug.edge_node_state import EdgeNodeState
from drivecomm.server.sparkplug.host_state import LATE_S, HostMessage, HostState, host_message
from drivecomm.server.sparkplug.limits import limits_of
from drivecomm.server.sparkplug.topics import SparkplugTopics, device_ids, is_id
from drivecomm.tomlfile import TomlTable

NOW_S = 1_700_000_000.0


def test_connection_number_wraps_around_and_is_stored(tmp_path):
    file = tmp_path / "state" / "sparkplug.json"
    numbers = [EdgeNodeState(file).next_connection() for _ in range(258)]
    assert numbers == [*range(256), 0, 1]
    kept = EdgeNodeState(file)
    kept.next_connection()
    kept.not_connected()
    # The connection failed, so that its number is used for the next one.
    assert kept.next_connection() == 2
    kept.passed_on(77)
    kept.waits("fan", 5, 9)
    kept.waits("fan", 3, 12)
    kept.save()
    known = EdgeNodeState(file)
    assert (known.bd_seq, known.row, known.waiting) == (2, 77, {"fan": (3, 12)})
    known.passed_on_later("fan")
    known.save()
    assert EdgeNodeState(file).waiting == {}


@pytest.mark.parametrize(
    "text", ["", "{", "[]", '{"bd_seq": 256, "row": -1, "waiting": [1]}', '{"bd_seq": true}', "\0"]
)
def test_malformed_session_file_is_ignored(tmp_path, text):
    file = tmp_path / "sparkplug.json"
    file.write_text(text)
    kept = EdgeNodeState(file)
    assert (kept.bd_seq, kept.row, kept.waiting) == (None, None, {})
    assert kept.next_connection() == 0


def test_session_works_with_an_unwritable_folder_and_warns(tmp_path, caplog):
    (tmp_path / "file").write_text("")
    kept = EdgeNodeState(tmp_path / "file" / "sparkplug.json")
    assert [kept.next_connection(), kept.next_connection()] == [0, 1]
    assert len(caplog.records) == 1
    assert "a late will of an earlier connection may end a session" in caplog.text


@pytest.mark.parametrize(
    "payload",
    [
        b"ONLINE", b"{", b"[]", b'{"online": 1, "timestamp": 5}', b'{"online": true, "timestamp": "5"}',
        b'{"online": true}', b'{"online": true, "timestamp": -1}', b"\xff", b"[" * 999, b" " * 2000,
    ],
)  # fmt: skip
def test_host_message_is_none_for_a_malformed_payload(payload):
    assert host_message(payload) is None


def test_host_message_holds_state_and_time():
    assert host_message(b'{"online": true, "timestamp": 5}') == HostMessage(online=True, time_ms=5)
    assert host_message(b'{"online": false, "timestamp": 4}') == HostMessage(online=False, time_ms=4)


NOW_MS = 1_800_000_000_000
HOUR_MS = 3_600_000


def host_after(*messages):
    """Return the host's state after messages.

    messages: online, the host's time and our time in ms, and the seconds since the message before.
    """
    host, now_s = HostState(), 50.0
    for online, said_ms, time_ms, pause_s in messages:
        now_s += pause_s
        host.heard(HostMessage(online, said_ms), time_ms=time_ms, now_s=now_s)
    return host.online


@pytest.mark.parametrize(
    ("messages", "online"),
    [
        pytest.param([(True, NOW_MS, NOW_MS, 0)], True, id="online"),
        pytest.param([(True, NOW_MS, NOW_MS, 0), (False, NOW_MS, NOW_MS + 5, 1)], False, id="will of this run"),
        pytest.param(
            [(True, NOW_MS, NOW_MS, 0), (False, NOW_MS - 1, NOW_MS + 5, 1)], True, id="will of an earlier run"
        ),
        pytest.param([(False, NOW_MS, NOW_MS, 0), (True, NOW_MS - 1, NOW_MS + 5, 1)], False, id="earlier online"),
        pytest.param(
            [(True, NOW_MS + 9000 * HOUR_MS, NOW_MS, 0), (False, NOW_MS + 5, NOW_MS + 5, 1)],
            False,
            id="from the future",
        ),
        pytest.param(
            [(False, NOW_MS + 9000 * HOUR_MS, NOW_MS, 0), (True, NOW_MS + 5, NOW_MS + 5, 1)], True, id="future offline"
        ),
        pytest.param(
            [(True, NOW_MS + HOUR_MS, NOW_MS, 0), (False, NOW_MS + HOUR_MS, NOW_MS + 5, 1)], False, id="fast clock"
        ),
        pytest.param(
            [(True, NOW_MS, NOW_MS, 0), (False, NOW_MS - HOUR_MS, NOW_MS + 5, LATE_S)], False, id="set back, later"
        ),
        pytest.param(
            [(False, NOW_MS, NOW_MS, 0), (True, NOW_MS - HOUR_MS, NOW_MS + 5, LATE_S)], True, id="restarted, set back"
        ),
        pytest.param(
            [(True, NOW_MS, NOW_MS, 0), (False, NOW_MS + 5, NOW_MS - HOUR_MS, 1)], False, id="our clock was set back"
        ),
    ],
)
def test_host_state_bounds_times_of_the_host_by_our_clock(messages, online):
    assert host_after(*messages) is online


def test_device_ids_replace_reserved_characters_and_are_unique():
    assert device_ids({each: each for each in ("pump", "hall/fan", "a+b#c")}) == {
        "pump": "pump",
        "hall/fan": "hall_fan",
        "a+b#c": "a_b_c",
    }
    with pytest.raises(UsageError, match="'hall/fan' and 'hall#fan' would both be the Sparkplug device 'hall_fan'"):
        device_ids({each: each for each in ("hall/fan", "hall#fan")})
    topics = SparkplugTopics(group="g", node="n")
    assert topics.device_of("spBv1.0/g/DCMD/n/pump") == "pump"
    for other in ("spBv1.0/g/DCMD/n/", "spBv1.0/g/DCMD/n/a/b", "spBv1.0/g/DCMD/m/pump", "spBv1.0/g/NCMD/n", ""):
        assert topics.device_of(other) == ""
    assert not is_id("\n")


class OneDrive:
    """A plant of one drive whose values and state the test sets."""

    name, session = "hall", "today"

    def __init__(self):
        poll = (PollGroup(parameters=("output_frequency", "210", "software_version")),)
        self.config = DriveConfig(protocol="vabus", address=1, name="pump", options={"model": "agile"}, poll=poll)
        self.state = DriveSnapshot(
            config=self.config, line="main", reachability="answers",
            status=DriveStatus(word=0x0F07, state=Motion.RUNNING, running=True, fault=False),
        )  # fmt: skip
        self.current = {}
        self.up = True

    def put(self, name, value=None, quality="good", *, age_s=0.0, unit="Hz", note="", keeps_s=3.0):
        reading = None
        if value is not None:
            reading = Reading(parameter=name, value=value, raw=0, unit=unit, name=name, note=note, time_s=NOW_S - age_s)
        self.current[name] = CurrentValue(
            drive="pump",
            name=name,
            reading=reading,
            quality=quality,
            time_s=NOW_S,
            keeps_s=keeps_s,
            cause="" if quality in FRESH else "why",
        )
        return self.current[name]

    def drives(self):
        return [self.state]

    def drive(self, _name):
        return self.state

    def values(self):
        return list(self.current.values())

    def lines(self):
        return [LineSnapshot(name="main", port="", up=self.up)]


@pytest.fixture
def plant():
    return OneDrive()


@pytest.fixture
def node(plant):
    return EdgeNode(plant, lambda _: [], limits_of)


def metric_of(messages, name):
    return next(each for message in messages for each in message.metrics if each.name == name)


QUALITIES = {
    "good": (("1.5", "good", ""), 1.5, 192, False),
    "good-by-a-model-that-is-not-sure": (("1.5", "good", "type and unit are derived"), 1.5, 192, True),
    "in-doubt": (("1.5", "uncertain", "another master is on the line"), 1.5, 500, True),
    "stale": (("1.5", "stale", ""), 1.5, 500, False),
    "stale-without-a-value": ((None, "stale", ""), None, 500, False),
    "bad": ((None, "bad", ""), None, 0, False),
}


@pytest.mark.parametrize("name", QUALITIES)
def test_metric_has_quality_and_uncertainty_of_its_value(plant, node, name):
    (number, quality, remark), value, code, uncertain = QUALITIES[name]
    plant.put("output_frequency", None if number is None else Decimal(number), quality, note=remark)
    metric = metric_of(node.births(0, NOW_S), "Values/output_frequency")
    assert metric.value == value
    assert metric.properties["Quality"].value == code
    assert metric.properties["Uncertain"].value is uncertain
    assert metric.properties["engUnit"].value == "Hz"


def test_value_without_new_readings_becomes_stale_once(plant, node):
    plant.put("output_frequency", Decimal("1.5"), keeps_s=3.0)
    node.births(0, NOW_S)
    assert node.periodic_messages(NOW_S + 2.9) == []
    (data,) = node.periodic_messages(NOW_S + 3.1)
    (metric,) = data.metrics
    assert (metric.value, metric.properties["Quality"].value) == (1.5, 500)
    assert metric.time_ms == round((NOW_S + 3.1) * 1000)
    assert node.periodic_messages(NOW_S + 4) == []


def test_birth_has_unread_values_and_a_change_of_type_causes_a_new_birth(plant, node):
    births = node.births(0, NOW_S)
    for name in ("output_frequency", "210", "software_version"):
        assert metric_of(births, f"Values/{name}").value is None
    assert metric_of(births, "Status/State").value is None
    (data,) = node.changed([plant.put("210", Decimal(3))], [], NOW_S)
    assert data.kind == "DDATA"
    (again,) = node.changed([plant.put("210", "ABC")], [], NOW_S)
    assert again.kind == "DBIRTH"
    assert metric_of([again], "Values/210").value == "ABC"
    # A metric without a value keeps its type.
    (data,) = node.changed([plant.put("210", None, "bad")], [], NOW_S)
    assert (data.kind, data.metrics[0].value) == ("DDATA", None)


def test_data_is_sent_on_change_and_its_times_never_decrease(plant, node):
    node.births(0, NOW_S)
    (first,) = node.changed([plant.put("210", Decimal(3))], [], NOW_S)
    assert node.changed([plant.put("210", Decimal(3))], [], NOW_S) == []
    (later,) = node.changed([plant.put("210", Decimal(4), age_s=3600)], [], NOW_S)
    assert later.metrics[0].time_ms == first.metrics[0].time_ms
    assert [each.name for each in later.metrics] == [""]
    assert set(later.metrics[0].properties) <= {"Quality", "Uncertain", "Reason"}


def test_unchanged_value_is_sent_when_its_quality_changes(plant, node):
    plant.put("output_frequency", Decimal(3))
    node.births(0, NOW_S)
    assert node.changed([plant.put("output_frequency", Decimal(3), age_s=-1.0)], [], NOW_S + 1) == []
    assert node.changed([plant.put("output_frequency", Decimal(3), age_s=-2.0)], [], NOW_S + 2) == []
    for value, time_s, code in (
        (plant.put("output_frequency", Decimal(3), "stale", age_s=-2.0), NOW_S + 8, 500),
        (plant.put("output_frequency", Decimal(3), age_s=-9.0), NOW_S + 9, 192),
    ):
        (data,) = node.changed([value], [], time_s)
        assert [(each.value, each.properties["Quality"].value) for each in data.metrics] == [(3.0, code)]
        assert node.changed([value], [], time_s) == []


def test_commander_and_line_state_are_sent_when_they_change(plant, node):
    node.births(0, NOW_S)
    holder = Caller(name="otto", role=Role.OPERATE, door="http")
    state = plant.state
    plant.state = DriveSnapshot(
        config=state.config, line="main", reachability="answers", status=state.status, kept="ramp",
        lease=Lease(drive="pump", holder=holder, until_s=0, key=""),
    )  # fmt: skip
    plant.up = False
    node_data, data = node.periodic_messages(NOW_S)
    assert [(each.kind, [metric.value for metric in each.metrics]) for each in (node_data, data)] == [
        ("NDATA", [False]), ("DDATA", ["otto (http)", "ramp"]),
    ]  # fmt: skip
    assert node.periodic_messages(NOW_S) == []


def test_removed_drive_dies_and_changed_drive_is_born_again(plant, node):
    node.births(0, NOW_S)
    plant.config = DriveConfig(protocol="vabus", address=2, name="pump", title="another")
    plant.state = DriveSnapshot(config=plant.config, line="main", reachability="answers")
    (birth,) = node.periodic_messages(NOW_S)
    assert (birth.kind, metric_of([birth], "Properties/Title").value) == ("DBIRTH", "another")
    plant.drives = list
    (death,) = node.periodic_messages(NOW_S)
    assert (death.kind, death.device) == ("DDEATH", "pump")


def test_silent_drive_dies_once_and_is_born_again_when_it_answers(plant, node):
    node.births(0, NOW_S)
    answering = plant.state
    plant.state = DriveSnapshot(config=plant.config, line="main", reachability="silent")
    (death,) = node.periodic_messages(NOW_S)
    assert (death.kind, death.device) == ("DDEATH", "pump")
    assert node.periodic_messages(NOW_S) == []
    plant.state = answering
    (birth,) = node.periodic_messages(NOW_S)
    assert birth.kind == "DBIRTH"


def test_aliases_are_the_same_after_a_restart_in_any_birth_order(plant, node):
    aliases = {each.name: each.alias for message in node.births(0, NOW_S) for each in message.metrics}
    plant.put("output_frequency", Decimal("1.5"))
    another = EdgeNode(plant, lambda _: [], limits_of)
    again = another.births(1, NOW_S)[::-1]
    assert {each.name: each.alias for message in again for each in message.metrics} == aliases
    assert len(set(aliases.values())) == len(aliases) - 1


def test_historical_data_has_only_metrics_of_the_birth(plant, node):
    plant.put("output_frequency", Decimal("1.5"))
    plant.put(STATUS, Decimal(0))
    node.births(0, NOW_S)

    def past(name, value, **more):
        said = {"drive": "pump", "name": name, "value": value, "quality": "good", "note": "", "raw": 7, "time_s": 5.0}
        return SimpleNamespace(**{**said, **more})

    values = [
        past("output_frequency", Decimal(2)), past("unknown", Decimal(2)), past("output_frequency", "text"),
        past(STATUS, "running"), past("output_frequency", None, quality="bad"),
    ]  # fmt: skip
    (message,) = node.past("pump", values)
    assert [each.value for each in message.metrics] == [2.0, "running", 7, None]
    assert all(each.is_historical and each.time_ms == 5000 and not each.name for each in message.metrics)
    assert node.past("nobody", values) == []


def test_limits_come_from_the_model():
    inverter = DriveConfig(protocol="fuji", address=1, options={"model": "e11s"})
    assert limits_of(inverter, "S05", "Hz") == (0, 400)
    assert limits_of(inverter, "S05", "kHz") == (0, Decimal("0.4"))
    for name, unit in (("S05", "A"), ("nothing", "")):
        assert limits_of(inverter, name, unit) == (None, None)
    for options in ({}, {"model": "none such"}):
        assert limits_of(DriveConfig(protocol="fuji", address=1, options=options), "S05", "Hz") == (None, None)


WRONG = {
    "no-group": ({"node": "n"}, "the key 'group' is missing"),
    "no-node": ({"group": "g"}, "the key 'node' is missing"),
    "a-slash": ({"group": "a/b", "node": "n"}, "invalid group = 'a/b'; write a text without / \\+ and #"),
    "a-wildcard": ({"group": "g", "node": "#"}, "invalid node = '#'"),
    "a-host": ({"group": "g", "node": "n", "host": ""}, "invalid host = ''"),
    "a-role": ({"group": "g", "node": "n", "role": "commission"}, "invalid role = 'commission'"),
    "two-ways": ({"group": "g", "node": "n", "broker": "mqtt://127.0.0.1", "brokers": ["mqtt://::1"]}, "leave one"),
    "none": ({"group": "g", "node": "n", "brokers": []}, "brokers lists one or more|brokers is a list of one or more"),
    "numbers": ({"group": "g", "node": "n", "brokers": [1]}, "brokers"),
    "elsewhere": (
        {"group": "g", "node": "n", "brokers": ["mqtt://127.0.0.1", "mqtt://example.com"]},
        "insecure = true",
    ),
    "unknown": ({"group": "g", "node": "n", "nod": "x"}, "unknown key 'nod'"),
}


@pytest.mark.parametrize("name", WRONG)
def test_invalid_sparkplug_setting_is_refused(name):
    said, words = WRONG[name]
    with pytest.raises(FileFormatError, match=words):
        sparkplug_door(TomlTable(said, "plant.toml", name="door 1"))


def test_door_is_named_after_its_edge_node():
    door = sparkplug_door(TomlTable({"kind": "sparkplug", "group": "hall 2", "node": "gateway"}, "plant.toml"))
    assert door.name == "sparkplug hall 2/gateway"
    assert json.dumps(door.name)
