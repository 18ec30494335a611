"""No door shows a time of 1970: an event that has not occurred has no time."""

import json
import time
from datetime import UTC, datetime

import pytest
from asyncua import ua
from every_door import until
from mosquitto import needs_mosquitto

pytestmark = [needs_mosquitto, pytest.mark.usefixtures("silent_fan")]

LONG_AGO_S = datetime(2020, 1, 1, tzinfo=UTC).timestamp()


@pytest.fixture(scope="module")
def silent_fan(hall, hands):  # noqa: ARG001 - connects the clients first
    """Silence the fan of the plant, so that each door shows missing values."""
    until(lambda: hall.plant.value("fan", "output_frequency"))
    hall.control.order("power", drive="fan", state="off")
    until(lambda: not hall.answers("fan"))
    until(lambda: hall.plant.value("fan", "output_frequency").quality == "bad")
    yield hall
    hall.control.order("power", drive="fan", state="on")
    until(lambda: hall.answers("fan"))


def early_in(content, place=""):
    """Yield the places in a JSON text with a time before LONG_AGO_S."""
    if isinstance(content, dict):
        for key, value in content.items():
            is_time = key in ("time_s", "source_s") or key.endswith(("ed_s", "since_s", "until_s"))
            if is_time and value is not None and value < LONG_AGO_S:
                yield f"{place}/{key} = {value}"
            yield from early_in(value, f"{place}/{key}")
    elif isinstance(content, list):
        for number, each in enumerate(content):
            yield from early_in(each, f"{place}[{number}]")


def test_http_door_shows_no_time_of_1970(hands):
    client, span = hands["http"].client("otto"), f"from={time.time() - 600}&to={time.time()}"
    for path in ("plant", "drives", "drives/fan", "values", "events", "leases", "alarms", "history/events"):
        assert list(early_in(client.get(f"/api/v1/{path}").content, path)) == []
    for drive in ("fan", "pump"):
        found = client.get(f"/api/v1/history?drive={drive}&name=output_frequency&{span}")
        assert found.status == 200, found.content
        assert list(early_in(found.content)) == []
    metrics = client.get("/metrics").content.decode()
    times = [line.split()[-1] for line in metrics.splitlines() if line.startswith("drivecomm_sample_timestamp")]
    assert times
    assert min(map(float, times)) > LONG_AGO_S


def test_mqtt_door_shows_no_time_of_1970(hands):
    heard = hands["mqtt"].broker
    topic = "drivecomm/hall/fan/output_frequency"
    until(lambda: any(json.loads(each)["quality"] == "bad" for each in heard.of(topic)))
    for topic, payload in list(heard.heard):
        if payload.startswith(b"{"):
            assert list(early_in(json.loads(payload), topic)) == []


def test_sparkplug_door_shows_no_time_of_1970(hands):
    hand = hands["sparkplug"]
    until(lambda: hand.messages("DDEATH", "fan"))
    for kind, device in (("NBIRTH", ""), ("DBIRTH", "pump"), ("DBIRTH", "fan"), ("DDATA", "fan"), ("DDEATH", "fan")):
        for message in hand.messages(kind, device):
            assert message.timestamp / 1000 > LONG_AGO_S
            assert [each.name for each in message.metrics if each.timestamp / 1000 < LONG_AGO_S] == []


def test_opc_ua_door_shows_no_time_of_1970(hands):
    hand = hands["opcua"]

    async def times_of(node):
        found = [] if await node.read_node_class() != ua.NodeClass.Variable else [
            await node.read_data_value(raise_on_bad_status=False)
        ]  # fmt: skip
        early = [
            f"{node}: {each}"
            for each in found
            for moment in (each.SourceTimestamp, each.ServerTimestamp, each.Value.Value if each.Value else None)
            if isinstance(moment, datetime) and moment.replace(tzinfo=UTC).timestamp() < LONG_AGO_S
        ]
        for child in await node.get_children():
            if child.nodeid.NamespaceIndex == 2:
                early += await times_of(child)
        return early

    async def all_times():
        plant = hand.otto.get_node(ua.NodeId("plant", 2))
        drive = hand.otto.get_node(ua.NodeId("drives/fan", 2))
        return [*await times_of(plant), *await times_of(drive)]

    assert hand.run(all_times()) == []
