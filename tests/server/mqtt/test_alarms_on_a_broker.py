"""Standing alarms retained on the broker, and acknowledged by the id that an event carries."""

import os

import pytest
from doors import listening
from mosquitto import mosquitto, until
from running_server import running_server
from served_core import awaited, simulated

from drivecomm.plant import read_plant

pytestmark = pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals are POSIX")

PLANT = """
format = 1
[server]
name = "hall"
status_period_s = 0.1
[[alarm]]
name = "tripped"
on = "fault"
[[door]]
kind = "mqtt"
broker = "{url}"
role = "operate"
[[line]]
name = "hall"
listen = "pty:{folder}/hall"
paced = false
[[drive]]
name = "pump"
drive = "vabus:1"
options = {{ model = "agile" }}
"""


@awaited
async def test_later_client_finds_alarms_on_the_broker_and_acknowledges_one(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    with mosquitto(tmp_path / "broker") as broker:
        file = tmp_path / "plant.toml"
        file.write_text(PLANT.format(folder=tmp_path, url=broker.url))
        with simulated(read_plant(file)) as (_, control), running_server(file) as plant:
            control.order("trip", drive="pump", code=5)
            await until(plant.alarms)
            await until(lambda: any(each.kind == "alarm" for each in plant.events()))
            async with listening(broker) as client:
                await until(lambda: (client.latest("bridge/alarms") or {}).get("alarms"))
                (alarm,) = client.latest("bridge/alarms")["alarms"]
                assert (alarm["drive"], alarm["rule"], alarm["present"]) == ("pump", "tripped", True)
                await until(lambda: client.session)
                answer = await client.request("acknowledge", alarm=alarm["id"])
                assert answer["outcome"] == "done"
                await until(lambda: client.latest("bridge/alarms")["alarms"][0]["acknowledged_by"])
                told = [each for each in client.payloads("bridge/event") if each["kind"] == "alarm"]
                assert {each["alarm"] for each in told} == {alarm["id"]}
