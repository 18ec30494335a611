"""Sites, areas and lines in the names of groups, edge nodes and devices."""

from dataclasses import replace

import pytest
from mosquitto import mosquitto, needs_mosquitto
from served_core import awaited
from sparkplug_listener import listening
from sparkplug_plant import command, gateway

from drivecomm.errors import FileFormatError
from drivecomm.server.sparkplug import SparkplugDoor
from drivecomm.tomlfile import TomlTable

LEVELS = {"enterprise": "Acme", "site": "Leeds", "area": "mixing", "plant": "hall 2", "line": ""}


def door_of(url, **keys):
    return SparkplugDoor(TomlTable({"broker": url, "role": "operate", "keep_alive_s": 2, **keys}, "plant.toml"))


@pytest.mark.parametrize(
    ("keys", "name"),
    [
        ({"levels": LEVELS}, "sparkplug Acme:Leeds:mixing/hall 2"),
        ({"levels": LEVELS, "group": "works", "node": "one"}, "sparkplug works/one"),
        ({"levels": {"site": "a/b+", "line": ""}, "node": "one"}, "sparkplug a_b_/one"),
        ({"levels": {"line": ""}, "group": "works", "node": "one"}, "sparkplug works/one"),
    ],
)
def test_group_and_node_come_from_levels_unless_the_door_gives_them(keys, name):
    assert door_of("mqtt://127.0.0.1", **keys).name == name


@pytest.mark.parametrize(
    ("levels", "sentence"),
    [
        ({"plant": "hall", "line": ""}, "the key 'group' is missing; write group = a text in quotes, or a site or an "),
        ({"site": "Leeds"}, "the key 'node' is missing; write node = a text in quotes, or plant among levels"),
    ],
)
def test_levels_that_name_no_group_or_node_are_refused(levels, sentence):
    with pytest.raises(FileFormatError) as caught:
        door_of("mqtt://127.0.0.1", levels=levels)
    assert sentence in str(caught.value)


@needs_mosquitto
@pytest.mark.soak
@awaited
async def test_device_names_begin_with_the_line(tmp_path):
    with mosquitto(tmp_path / "broker") as broker:
        door = door_of(broker.url, levels=LEVELS)
        async with listening(broker.port) as host, gateway(tmp_path, door) as served:
            await host.until(lambda: {each.device for each in host.of("DBIRTH")} == {"hall:pump", "yard:fan"})
            assert host.of("DBIRTH")[0].topic.startswith("spBv1.0/Acme:Leeds:mixing/DBIRTH/hall 2/")
            drive = served.core.plant.drive("fan")
            *place, metric = door.address_of("hall", drive, "output_frequency").split("/", 3)
            assert place == ["Acme:Leeds:mixing", "hall 2", "yard:fan"]
            await host.until(lambda: host.value("yard:fan", metric) is not None)
            payload = command("Command/Stop", value=True)
            await host.client.publish("spBv1.0/Acme:Leeds:mixing/DCMD/hall 2/yard:fan", payload)
            await host.until(lambda: host.value("yard:fan", "Answer/Outcome") == "done")
            drives = tuple(replace(each, line="yard") for each in served.core.plant.drives)
            await served.core.changed(replace(served.core.plant, drives=drives))
            await host.until(lambda: host.of("DDEATH", device="hall:pump"))
