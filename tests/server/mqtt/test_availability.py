"""Availability of drives, retained on the broker and published again on each connection, since brokers forget."""

import json
from dataclasses import replace

import pytest
from doors import listening, open_door
from mosquitto import mosquitto, needs_mosquitto, until
from served_core import awaited, core_of

from drivecomm.server.drift_state import DriveDrift, SetChange

pytestmark = needs_mosquitto

ONLINE = {f"drivecomm/hall/{drive}/availability": b'{"state":"online"}' for drive in ("pump", "fan", "mixer")}


@awaited
async def test_availability_is_published_again_to_a_restarted_broker(tmp_path):
    with mosquitto(tmp_path / "broker") as broker:
        async with core_of(tmp_path) as (core, _), open_door(core, broker) as door:
            await until(lambda: all(each.reachability == "answers" for each in core.drives()))
            for _ in range(2):
                await until(lambda: door.broker.connected)
                async with listening(broker) as client:
                    await until(lambda client=client: latest(client).items() >= ONLINE.items())
                with broker.away():
                    await until(lambda: not door.broker.connected)


@pytest.mark.soak
@awaited
async def test_drift_of_a_drive_is_retained_and_cleared_with_the_drive(tmp_path):
    topic = "drivecomm/hall/pump/drift"
    change = SetChange(address="420", name="", unit="s", approved=5, now=7, since_s=60.0)
    with mosquitto(tmp_path / "broker") as broker:
        async with core_of(tmp_path) as (core, _), open_door(core, broker):
            core.drift["pump"] = DriveDrift(state="changed", changes=(change,))
            async with listening(broker) as client:
                await until(lambda: topic in latest(client))
                assert json.loads(latest(client)[topic]) == {
                    "state": "changed", "changed": 1, "since_s": 60.0,
                    "text": "1 parameter differs from the baseline since 1970-01-01 00:01 UTC: 420: 5 -> 7 s",
                }  # fmt: skip
                core.drift["pump"] = DriveDrift(state="as approved")
                await until(lambda: json.loads(latest(client)[topic])["changed"] == 0)
                await until(lambda: b'"pump"' in latest(client).get("drivecomm/hall/bridge/info", b""))
            plant = core.plant
            await core.changed(replace(plant, drives=tuple(each for each in plant.drives if each.name != "pump")))
            async with listening(broker) as client:
                await until(lambda: "drivecomm/hall/fan/availability" in latest(client))
                await until(lambda: not latest(client).get(topic))


def latest(client):
    return {each.topic: bytes(each.payload) for each in client.heard}
