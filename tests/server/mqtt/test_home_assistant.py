"""Discovery messages for Home Assistant on a real broker: complete, and without commands that could act later."""

import asyncio
import json
import time
from dataclasses import replace
from decimal import Decimal

import pytest
from doors import listening, open_door
from mosquitto import mosquitto, needs_mosquitto, until
from served_core import PLANT, awaited, core_of, runs

from drivecomm.client import parsed
from drivecomm.plant import read_plant
from drivecomm.protocol import Reading
from drivecomm.server import CurrentValue
from drivecomm.server.broker import BrokerMessage
from drivecomm.server.mqtt.kinds import kind_of, state_kinds
from drivecomm.server.mqtt.retained_state import drives_in_inventory

pytestmark = needs_mosquitto

PLACE = "homeassistant/device/drivecomm_hall_{}/config"
MORE = '["output_frequency", "16-34"]'
ALLOWED = PLANT.replace(
    'policy = "coast", watchdog_s = 2 }', 'policy = "hold" }\nnetwork = { mqtt = ["start", "reference"] }'
).replace('network = { http = ["start"', 'network = { mqtt = ["start"')


def discovery_messages(client, drive):
    """Return the discovery messages of a drive, newest first."""
    found = [parsed(each.payload) for each in client.heard if each.topic == PLACE.format(drive) and each.payload]
    return found[::-1]


async def known(client, core):
    await until(lambda: core.drive("fan").reachability == "answers")
    await until(
        lambda: (
            discovery_messages(client, "fan")
            and "output_frequency" in discovery_messages(client, "fan")[0]["components"]
        )
    )
    await until(lambda: "unit_of_measurement" in discovery_messages(client, "fan")[0]["components"]["output_frequency"])


@pytest.mark.soak
@awaited
async def test_drive_is_a_device_with_sensors(tmp_path):
    with mosquitto(tmp_path / "broker") as broker:
        async with (
            core_of(tmp_path, ALLOWED) as (core, _),
            listening(broker) as client,
            open_door(core, broker, home_assistant="homeassistant"),
        ):
            await known(client, core)
            fan = discovery_messages(client, "fan")[0]
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
            # Without a role there are no buttons.
            shown = {key: each for key, each in fan["components"].items() if len(each) > 1}
            assert {each["platform"] for each in shown.values()} == {"sensor", "binary_sensor"}
            ids = [
                each["unique_id"]
                for name in ("fan", "pump")
                for each in discovery_messages(client, name)[0]["components"].values()
                if len(each) > 1
            ]
            assert len(ids) == len(set(ids))


@pytest.mark.soak
@awaited
async def test_discovery_is_repeated_when_home_assistant_starts_and_on_each_connection(tmp_path):
    with mosquitto(tmp_path / "broker") as broker:
        async with (
            core_of(tmp_path, ALLOWED) as (core, _),
            listening(broker) as client,
            open_door(core, broker, home_assistant="homeassistant"),
        ):
            await known(client, core)
            await asyncio.sleep(1.5)
            before = len(discovery_messages(client, "fan"))
            await client.connection.publish(BrokerMessage(topic="homeassistant/status", payload="offline"))
            await asyncio.sleep(1.5)
            assert len(discovery_messages(client, "fan")) == before
            await client.connection.publish(BrokerMessage(topic="homeassistant/status", payload="online"))
            await until(lambda: len(discovery_messages(client, "fan")) == before + 1)
            await client.cut()
            await until(lambda: len(discovery_messages(client, "fan")) == before + 2)


def pressed(template, session):
    """Fill in a template as Home Assistant does, and check that it contains the session."""
    now = f"{time.time():.6f}"
    text = template.replace("{{ now().timestamp() }}", now).replace("{{ range(100000) | random }}", "12345")
    assert session in text
    return text.replace("{{ value }}", "40")


@pytest.mark.soak
@awaited
async def test_buttons_exist_for_allowed_verbs_and_are_valid_for_one_connection(tmp_path):
    with mosquitto(tmp_path / "broker") as broker:
        async with (
            core_of(tmp_path, ALLOWED) as (core, control),
            listening(broker) as client,
            open_door(core, broker, home_assistant="homeassistant", role="operate"),
        ):
            await known(client, core)
            parts = discovery_messages(client, "fan")[0]["components"]
            assert parts["command_reset"] == {"platform": "button"}
            number = parts["command_reference"]
            assert (number["platform"], number["min"], number["max"]) == ("number", 0, 100)
            session = client.session
            await client.connection.publish(
                BrokerMessage(topic=number["command_topic"], payload=pressed(number["command_template"], session))
            )
            await until(lambda: client.payloads("fan/response"))
            assert client.latest("fan/response")["outcome"] == "done", client.latest("fan/response")
            start = parts["command_start"]
            await client.cut()
            await client.connection.publish(
                BrokerMessage(topic=start["command_topic"], payload=pressed(start["command_template"], session))
            )
            await until(lambda: len(client.payloads("fan/response")) == 2)
            assert client.latest("fan/response")["outcome"] == "refused"
            await until(
                lambda: (
                    client.session
                    in discovery_messages(client, "fan")[0]["components"]["command_start"]["command_template"]
                )
            )
            again = discovery_messages(client, "fan")[0]["components"]["command_start"]["command_template"]
            await client.connection.publish(
                BrokerMessage(topic=start["command_topic"], payload=pressed(again, client.session))
            )
            await until(lambda: runs(control, "fan"))
            stop = parts["command_stop"]
            # A drive that seems silent can still be stopped.
            assert [each["topic"] for each in stop["availability"]] == ["drivecomm/hall/bridge/state"]
            await client.connection.publish(BrokerMessage(topic=stop["command_topic"], payload=stop["payload_press"]))
            await until(lambda: not runs(control, "fan"))
            # Home Assistant does not renew a lease, so verbs that need a lease have no button.
            assert discovery_messages(client, "pump")[0]["components"]["command_start"] == {"platform": "button"}


def a_value(name="output_frequency", content=Decimal("12.5"), **more):
    reading = Reading(parameter="1", value=content, raw=1, **more)
    return CurrentValue(time_s=1.0, drive="fan", name=name, reading=reading, quality="good")


@pytest.mark.parametrize(
    ("name", "content", "unit", "shown"),
    [
        ("heat_sink_temperature", Decimal(40), "degC", ("temperature", "°C", "measurement")),
        ("16-34", Decimal(40), "°C", ("temperature", "°C", "measurement")),
        ("motor_speed", 1450, "rpm", (None, "rpm", "measurement")),
        ("16-17", 1450, "1/min", (None, "rpm", "measurement")),
        ("energy", 7, "kWh", ("energy", "kWh", "total_increasing")),
        ("running_hours", 7, "h", ("duration", "h", "total_increasing")),
        ("power_ups", 7, "", (None, None, "total_increasing")),
        ("torque", 7, "Nm", (None, "Nm", "measurement")),
        ("fault_code", 7, "", (None, None, None)),
        ("serial_number", "0012", "", (None, None, None)),
    ],
)
def test_quantity_has_its_device_class_unit_and_state_class(name, content, unit, shown):
    found = kind_of(a_value(name, content, unit=unit), "")
    assert tuple(found.get(key) for key in ("device_class", "unit_of_measurement", "state_class")) == shown


def test_sensor_kind_is_known_before_a_read_for_common_names_only():
    """Home Assistant drops the statistics of a sensor whose unit comes and goes."""
    unread = CurrentValue(time_s=1.0, drive="fan", name="motor_current", reading=None, quality="bad")
    assert kind_of(unread, "") is None
    unread = replace(unread, name="output_current")
    assert kind_of(unread, "") == kind_of(a_value("output_current", unit="A"), "")
    reading = Reading(parameter="15-43", name="software_version", value="5.11", raw=1)
    found = kind_of(CurrentValue(time_s=1.0, drive="fan", name="15-43", reading=reading, quality="good"), "")
    assert found["name"] == "15-43 software version"
    assert kind_of(a_value("output_frequency", unit="Hz"), "")["name"] == "Output frequency"


def test_problem_sensor_is_unknown_without_a_fresh_state():
    """The template gives OFF only for a fresh state."""
    state, problem = state_kinds("")
    assert state["options"] == ["not_ready", "ready", "running", "stopping", "fault"]
    template = problem["value_template"]
    assert template.endswith("if value_json is defined and value_json.quality in ['good', 'uncertain'] else None }}")


@pytest.mark.parametrize(
    "payload", [b"", b"x", b"[]", b'{"drives":[{"name":"a"}]}', b'{"drives":[3]}', b'{"drives":7}']
)
def test_malformed_discovery_of_an_earlier_run_is_ignored(payload):
    assert drives_in_inventory(payload, "drivecomm/hall") == {}


@pytest.mark.parametrize("topic", ["drivecomm/hallway/a", "other/a", "drivecomm/hall/+", "drivecomm/hall/a/#"])
def test_drive_below_another_prefix_is_ignored(topic):
    payload = json.dumps({"drives": [{"name": "a", "topic": topic, "quantities": ["status"]}]}).encode()
    assert drives_in_inventory(payload, "drivecomm/hall") == {}


@pytest.mark.soak
@awaited
async def test_removed_drives_and_quantities_of_the_last_run_are_cleared(tmp_path):
    with mosquitto(tmp_path / "broker") as broker:
        async with listening(broker) as client:
            async with (
                core_of(tmp_path, ALLOWED.replace('["output_frequency"]', MORE)) as (core, _),
                open_door(core, broker, home_assistant="homeassistant"),
            ):
                await known(client, core)
                await until(lambda: client.latest("fan/16-34"))
                await until(lambda: client.payloads("pump/status"))
                await until(lambda: "16-34" in str(client.latest("bridge/info")))
            without = ALLOWED[: ALLOWED.index('[[drive]]\nname = "mixer"')]
            first, last = without.index('[[drive]]\nname = "pump"'), without.index('[[drive]]\nname = "fan"')
            async with (
                core_of(tmp_path, without[:first] + without[last:]) as (core, _),
                open_door(core, broker, home_assistant="homeassistant"),
            ):
                await until(lambda: kept(client, "drivecomm/hall/fan/16-34") == b"")
                await until(lambda: kept(client, "drivecomm/hall/pump/status") == b"")
                assert kept(client, PLACE.format("pump")) == b""
                assert kept(client, PLACE.format("mixer")) == b""
                assert kept(client, "drivecomm/hall/pump/availability") == b""
                assert {"platform": "sensor"} in [
                    each["components"].get("16_34") for each in discovery_messages(client, "fan")
                ]
                assert kept(client, PLACE.format("fan"))
                await until(lambda: "16-34" not in str(client.latest("bridge/info")))


def kept(client, topic):
    return [each.payload for each in client.heard if each.topic == topic][-1]


@pytest.mark.soak
@awaited
async def test_quantity_removed_from_polling_leaves_the_message_of_its_drive(tmp_path):
    with mosquitto(tmp_path / "broker") as broker:
        both = ALLOWED.replace('["output_frequency"]', MORE)
        async with (
            core_of(tmp_path, both) as (core, _),
            listening(broker) as client,
            open_door(core, broker, messages="drives", home_assistant="homeassistant"),
        ):
            await until(lambda: "16-34" in (client.latest("fan/values") or {}))
            file = tmp_path / "plant.toml"
            file.write_text(ALLOWED)
            await core.changed(read_plant(file))
            # For a moment after the change only the status may be known.
            await until(
                lambda: "16-34" not in client.latest("fan/values") and "output_frequency" in client.latest("fan/values")
            )
