"""State of many plants from their published messages, in any order, and with foreign messages among them."""

import asyncio
import json
from contextlib import asynccontextmanager
from types import SimpleNamespace

import pytest
from hypothesis import given, settings, strategies as st

from drivecomm.errors import LinkDownError
from drivecomm.server import cancel_and_wait
from drivecomm.server.broker import ReceivedMessage
from drivecomm.server.fleet import Fleet, FleetSubscription, following

ONLINE = {"state": "online", "session": "x", "plant": "mill", "version": "1", "since_s": 1000.5}
RUNNING = {"value": "running", "unit": "", "quality": "good", "time_s": 2000.25}
FAULT = {**RUNNING, "value": "fault", "text": "14 earth fault", "time_s": 2001.0}


def heard(*messages, fleet=None):
    fleet = fleet or Fleet()
    for topic, content in messages:
        payload = content if isinstance(content, bytes) else json.dumps(content).encode()
        fleet.take(f"drivecomm/{topic}", payload)
    return fleet


def mill(*more):
    return heard(
        ("mill/bridge/state", ONLINE),
        ("mill/bridge/info", {"drives": [{"name": "pump", "model": "agile"}, {"name": "fan", "title": "roof"}]}),
        ("mill/pump/availability", {"state": "online"}),
        ("mill/pump/status", RUNNING),
        ("mill/fan/availability", {"state": "online"}),
        ("mill/fan/status", FAULT),
        *more,
    )


def test_plant_summary_counts_drives_and_alarms():
    summary = mill().plants["mill"].summary
    assert summary == ("mill", "online", 2, 2, 1, 1, 0, 2001.0, 0, "1", "", "", None)


def test_plant_shows_its_version_plant_file_and_alarms():
    alarm = {"id": "a-1", "rule": "tripped", "drive": "fan", "text": "fault 14", "since_s": 5, "over_s": None}
    file = {"name": "mill.toml", "sha256": "abcdef", "read_s": 1000.5}
    plant = mill(("mill/bridge/info", {"drives": [], "file": file}), ("mill/bridge/alarms", {"alarms": [alarm]}))
    assert plant.plants["mill"].summary[8:] == (1, "1", "mill.toml", "abcdef", 1000.5)
    assert plant.plants["mill"].alarms == (("a-1", "tripped", "fan", "fault 14", 5.0, None, ""),)


def test_drives_are_shown_in_plant_order_for_any_message_order():
    fleet = heard(("mill/fan/status", RUNNING), ("mill/bridge/info", {"drives": [{"name": "pump"}, {"name": "fan"}]}))
    assert [drive.name for drive in fleet.plants["mill"].shown] == ["pump", "fan"]


def test_plant_below_topic_levels_takes_only_its_own_drives():
    told = {"drives": [{"name": "pump", "topic": "drivecomm/leeds/mixing/l1/pump"}]}
    theft = {"drives": [{"name": "fan", "topic": "drivecomm/leeds/mixing/l1/pump"}]}
    fleet = heard(
        ("leeds/mixing/bridge/state", ONLINE),
        ("leeds/mixing/bridge/info", told),
        ("york/mixing/bridge/info", theft),
        ("leeds/mixing/l1/pump/status", RUNNING),
        ("leeds/mixing/l1/fan/status", RUNNING),
    )
    assert fleet.plants["leeds/mixing"].drives["pump"].state == "running"
    assert list(fleet.plants["leeds/mixing"].drives) == ["pump"]
    assert fleet.plants["york/mixing"].drives["fan"].values == {}
    assert "drivecomm/+/+/+/+/status" in fleet.filters
    assert "drivecomm/+/+/+/+/status" not in Fleet().filters


def test_offline_plant_has_no_drive_states():
    plant = mill(("mill/bridge/state", {"state": "offline"})).plants["mill"]
    assert plant.summary[:7] == ("mill", "offline", 2, 0, 0, 0, 0)


def test_plants_are_unknown_without_the_broker():
    fleet = mill()
    fleet.silent()
    assert fleet.plants["mill"].summary.gateway == "unknown"
    assert fleet.plants["mill"].summary.running == 0


def test_silent_drive_has_no_state():
    plant = mill(("mill/pump/availability", {"state": "offline"})).plants["mill"]
    assert plant.drives["pump"].state == ""
    assert (plant.summary.running, plant.summary.silent) == (0, 1)


def test_stale_status_gives_no_state():
    plant = mill(("mill/pump/status", {**RUNNING, "quality": "stale"})).plants["mill"]
    assert plant.drives["pump"].state == ""


def test_one_message_carries_all_values_of_a_drive():
    plant = mill(("mill/pump/values", {"status": FAULT, "output_frequency": {**RUNNING, "value": 12.5, "unit": "Hz"}}))
    drive = plant.plants["mill"].drives["pump"]
    assert (drive.state, drive.fault) == ("fault", "14 earth fault")
    assert str(drive.values["output_frequency"].value) == "12.5"


def test_cleared_retained_message_removes_plant_or_status():
    assert heard(("mill/bridge/state", b""), fleet=mill()).plants == {}
    plant = heard(("mill/pump/status", b""), fleet=mill()).plants["mill"]
    assert plant.drives["pump"].state == ""


def test_drive_removed_from_the_plant_is_not_shown():
    plant = mill(("mill/bridge/info", {"drives": [{"name": "fan"}]})).plants["mill"]
    assert [drive.name for drive in plant.shown] == ["fan"]
    assert plant.summary.drives == 1


def test_names_with_reserved_characters_are_decoded_from_topics():
    fleet = heard(("hall%2F2/bridge/state", ONLINE), ("hall%2F2/%62ridge/status", RUNNING))
    assert fleet.plants["hall/2"].drives["bridge"].state == "running"


def test_topic_prefix_may_have_several_levels():
    fleet = Fleet("plants/north")
    assert "plants/north/+/bridge/state" in fleet.filters
    fleet.take("plants/north/mill/bridge/state", json.dumps(ONLINE).encode())
    fleet.take("plants/south/mill/bridge/state", json.dumps(ONLINE).encode())
    assert list(fleet.plants) == ["mill"]


def test_unreadable_messages_are_counted_and_ignored():
    fleet = mill(
        ("mill/pump/status", b"\xff\xfe"),
        ("mill/pump/status", b"[1]"),
        ("mill/pump/status", b'{"value":1}'),
        ("mill/pump/status", b'{"value":1,"quality":"good","time_s":"nan"}'),
        ("mill/bridge/state", b"{}"),
        ("mill/bridge/info", b'{"drives":7}'),
        ("mill/pump/status", b"x" * (5 * 1024 * 1024)),
    )
    assert fleet.unreadable == 7
    assert fleet.plants["mill"].summary == mill().plants["mill"].summary


@pytest.mark.soak
@settings(deadline=None)
@given(
    st.lists(
        st.tuples(
            st.sampled_from(
                ["a/bridge/state", "a/bridge/info", "a/b/status", "a/b/values", "a/b/availability", "a/b", ""]
            ),
            st.binary(max_size=20)
            | st.recursive(
                st.none() | st.booleans() | st.floats() | st.text(max_size=5),
                lambda inner: (
                    st.lists(inner, max_size=3)
                    | st.dictionaries(st.sampled_from(["drives", "state", "name", "value", "quality", "time_s"]), inner)
                ),
                max_leaves=10,
            ).map(lambda content: json.dumps(content).encode()),
        ),
        max_size=10,
    )
)
def test_fleet_can_be_shown_after_any_messages(messages):
    fleet = heard(*messages)
    for plant in fleet.plants.values():
        assert plant.summary.drives == len(plant.shown)
        assert all(isinstance(drive.state, str) for drive in plant.shown)


class Refusing:
    """A broker that refuses some subscriptions. of: text in the refused filters; messages: retained messages."""

    def __init__(self, of, messages):
        self.of, self.messages = of, messages

    @asynccontextmanager
    async def connected(self, _settings, _client_id, received):
        self.received = received
        yield self

    async def subscribe_with_kept(self, *filters):
        if any(self.of in each for each in filters):
            raise LinkDownError("the broker does not allow this client to subscribe")
        for topic, content in self.messages:
            payload = json.dumps(content).encode()
            self.received(ReceivedMessage(topic=f"drivecomm/{topic}", payload=payload, retained=True))

    async def lost(self):
        await asyncio.Event().wait()


def test_refused_deep_subscription_does_not_affect_other_plants(monkeypatch):
    deep = {"drives": [{"name": "pump", "topic": "drivecomm/leeds/mixing/l1/pump"}]}
    kept = [("leeds/mixing/bridge/info", deep), ("mill/bridge/state", ONLINE), ("mill/pump/status", RUNNING)]
    monkeypatch.setattr(following, "connect_to_broker", Refusing("+/+/+/+/status", kept).connected)
    settings = SimpleNamespace(client_id="")

    async def test():
        one = FleetSubscription(settings, Fleet())
        running = asyncio.create_task(one.run())
        async with asyncio.timeout(10):
            while not one.problem:  # noqa: ASYNC110 - the task sets the attribute
                await asyncio.sleep(0.01)
        assert one.fleet.plants["mill"].summary.running == 1
        assert not running.done()
        await cancel_and_wait(running)
        with pytest.raises(LinkDownError, match="does not allow"):
            await FleetSubscription(settings, Fleet()).known()

    asyncio.run(test())
