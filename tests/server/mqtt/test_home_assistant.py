"""What Home Assistant is told of drives, on a real broker: what it needs, and nothing that could act later."""

import asyncio
import time

from doors import listening, open_door
from mosquitto import mosquitto, needs_mosquitto, until
from served_core import PLANT, awaited, core_of, runs

from drivecomm.client import parsed
from drivecomm.server.broker import Message

pytestmark = needs_mosquitto

PLACE = "homeassistant/device/drivecomm_hall_{}/config"
ALLOWED = PLANT.replace(
    'policy = "coast", watchdog_s = 2 }', 'policy = "hold" }\nnetwork = { mqtt = ["start", "reference"] }'
).replace('network = { http = ["start"', 'network = { mqtt = ["start"')


def told(client, drive):
    """Return what was told of a drive, the latest first."""
    found = [parsed(each.payload) for each in client.heard if each.topic == PLACE.format(drive) and each.payload]
    return found[::-1]


async def known(client, core):
    await until(lambda: core.drive("fan").reachability == "answers")
    await until(lambda: told(client, "fan") and "output_frequency" in told(client, "fan")[0]["components"])
    await until(lambda: "unit_of_measurement" in told(client, "fan")[0]["components"]["output_frequency"])


@awaited
async def test_a_drive_is_a_device_with_sensors(tmp_path):
    with mosquitto(tmp_path / "broker") as broker:
        async with (
            core_of(tmp_path, ALLOWED) as (core, _),
            listening(broker) as client,
            open_door(core, broker, home_assistant="homeassistant"),
        ):
            await known(client, core)
            fan = told(client, "fan")[0]
            assert fan["device"]["identifiers"] == ["drivecomm_hall_fan"]
            assert fan["origin"]["name"] == "drivecomm"
            assert fan["availability_mode"] == "all"
            assert [each["topic"] for each in fan["availability"]] == [
                "drivecomm/hall/bridge/state",
                "drivecomm/hall/fan/availability",
            ]
            sensor = fan["components"]["output_frequency"]
            assert sensor["platform"] == "sensor"
            assert (sensor["device_class"], sensor["unit_of_measurement"]) == ("frequency", "Hz")
            assert sensor["state_class"] == "measurement"
            assert sensor["unique_id"] == "drivecomm_hall_fan_output_frequency"
            assert sensor["default_entity_id"] == "sensor.drivecomm_hall_fan_output_frequency"
            assert sensor["expire_after"] >= 10
            assert sensor["state_topic"] in {each.topic for each in client.heard}
            assert fan["components"]["problem"]["device_class"] == "problem"
            # Without a role nothing can be pressed there.
            assert {each["platform"] for each in fan["components"].values()} == {"sensor", "binary_sensor"}
            ids = [
                each["unique_id"] for name in ("fan", "pump") for each in told(client, name)[0]["components"].values()
            ]
            assert len(ids) == len(set(ids))


@awaited
async def test_it_is_told_again_when_it_begins_and_with_each_connection(tmp_path):
    with mosquitto(tmp_path / "broker") as broker:
        async with (
            core_of(tmp_path, ALLOWED) as (core, _),
            listening(broker) as client,
            open_door(core, broker, home_assistant="homeassistant"),
        ):
            await known(client, core)
            await asyncio.sleep(1.5)
            before = len(told(client, "fan"))
            await client.connection.publish(Message(topic="homeassistant/status", payload="offline"))
            await asyncio.sleep(1.5)
            assert len(told(client, "fan")) == before
            await client.connection.publish(Message(topic="homeassistant/status", payload="online"))
            await until(lambda: len(told(client, "fan")) == before + 1)
            await client.cut()
            await until(lambda: len(told(client, "fan")) == before + 2)


def pressed(template, session):
    """Fill in a template as Home Assistant does."""
    now = f"{time.time():.6f}"
    text = template.replace("{{ now().timestamp() }}", now).replace("{{ range(100000, 999999) | random }}", "123456")
    assert session in text
    return text.replace("{{ value }}", "40")


@awaited
async def test_what_may_be_done_can_be_pressed_and_counts_for_this_connection_only(tmp_path):
    with mosquitto(tmp_path / "broker") as broker:
        async with (
            core_of(tmp_path, ALLOWED) as (core, control),
            listening(broker) as client,
            open_door(core, broker, home_assistant="homeassistant", role="operate"),
        ):
            await known(client, core)
            parts = told(client, "fan")[0]["components"]
            assert "command_reset" not in parts
            number = parts["command_reference"]
            assert (number["platform"], number["min"], number["max"]) == ("number", 0, 100)
            session = client.session
            await client.connection.publish(
                Message(topic=number["command_topic"], payload=pressed(number["command_template"], session))
            )
            await until(lambda: client.payloads("fan/response"))
            assert client.latest("fan/response")["outcome"] == "done", client.latest("fan/response")
            start = parts["command_start"]
            await client.cut()
            await client.connection.publish(
                Message(topic=start["command_topic"], payload=pressed(start["command_template"], session))
            )
            await until(lambda: len(client.payloads("fan/response")) == 2)
            assert client.latest("fan/response")["outcome"] == "refused"
            await until(
                lambda: client.session in told(client, "fan")[0]["components"]["command_start"]["command_template"]
            )
            again = told(client, "fan")[0]["components"]["command_start"]["command_template"]
            await client.connection.publish(
                Message(topic=start["command_topic"], payload=pressed(again, client.session))
            )
            await until(lambda: runs(control, "fan"))
            stop = parts["command_stop"]
            await client.connection.publish(Message(topic=stop["command_topic"], payload=stop["payload_press"]))
            await until(lambda: not runs(control, "fan"))
            # Nobody renews a lease there: what would need one has no button.
            assert "command_start" not in told(client, "pump")[0]["components"]
