"""A complete server with a Sparkplug door: killed, restarted, duplicated, and after an outage of the broker."""

import asyncio
import json
import os
import signal
import time
from importlib.metadata import entry_points

import pytest
from mosquitto import mosquitto, needs_mosquitto
from processes import QUICK, serving
from served_core import awaited
from sparkplug_grader import Seen, graded
from sparkplug_listener import Wire, listening
from sparkplug_plant import door_of, gateway

pytestmark = [needs_mosquitto, pytest.mark.soak]

DOOR = """
[[door]]
kind = "sparkplug"
broker = "{url}"
group = "plant"
node = "gateway"
role = "operate"
keep_alive_s = 2
"""


@pytest.fixture
def installed(tmp_path):
    """Return environment variables that make the entry point of the door known, even to an older installed version."""
    if any(each.name == "sparkplug" for each in entry_points(group="drivecomm.doors")):
        return {}
    folder = tmp_path / "site" / "sparkplug_door-1.dist-info"
    folder.mkdir(parents=True)
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: sparkplug-door\nVersion: 1\n")
    (folder / "entry_points.txt").write_text(
        "[drivecomm.doors]\nsparkplug = drivecomm.server.sparkplug:sparkplug_door\n"
    )
    return {"PYTHONPATH": os.pathsep.join([str(folder.parent), os.environ.get("PYTHONPATH", "")])}


@awaited
async def test_killed_server_sends_its_death_and_later_the_missed_values(tmp_path, installed):
    with mosquitto(tmp_path / "broker") as broker:
        async with listening(broker.port) as host, Wire(broker.port) as wire:
            head = QUICK + DOOR.format(url=wire.url)
            opened = serving(tmp_path, head=head, **installed)
            served = await asyncio.to_thread(opened.__enter__)
            try:
                await host.until(lambda: {each.device for each in host.of("DBIRTH")} == {"pump", "fan"}, 30)
                await asyncio.sleep(3)
                await asyncio.to_thread(served.end, signal.SIGKILL)
                killed_ms = time.time() * 1000
                # The broker publishes the death, which is the will of the connection.
                await host.until(lambda: host.of("NDEATH"))
                number = host.of("NBIRTH")[-1].metric("bdSeq").long_value
                assert host.of("NDEATH")[-1].message.metrics[0].long_value == number
                await asyncio.to_thread(served.start)
                await host.until(lambda: len(host.of("NBIRTH")) >= 2, 30)
                assert host.of("NBIRTH")[-1].metric("bdSeq").long_value == number + 1
                # Values sent just before the kill are sent again, marked as historical.
                past = await host.until(
                    lambda: [
                        at
                        for at, _ in host.values("fan", "Status/State", historical=True)
                        if killed_ms - 6000 < at < killed_ms
                    ],
                    30,
                )
                assert past
            finally:
                await asyncio.to_thread(opened.__exit__, None, None, None)
            seen = Seen(host.heard, wire.packets)
            assert not graded(seen).wrong, graded(seen).wrong[:10]


@awaited
async def test_two_gateways_of_one_name_report_the_conflict_and_stop_reconnecting(tmp_path):
    (tmp_path / "one").mkdir()
    (tmp_path / "two").mkdir()
    with mosquitto(tmp_path / "broker") as broker:
        async with listening(broker.port) as host, gateway(tmp_path / "one", door_of(broker.url), journal=False) as one:
            await host.until(lambda: host.of("NBIRTH"))
            async with gateway(tmp_path / "two", door_of(broker.url), journal=False):
                await asyncio.sleep(15)
            births = len(host.of("NBIRTH"))
            told = [each.text for each in one.core.table.events() if each.kind == "door"]
            assert [each for each in told if "check for another edge node plant/gateway" in each], told
            # Each gateway reconnects several times before it detects the conflict.
            assert births <= 12, (births, told)


@awaited
async def test_history_of_a_drive_silent_after_an_outage_follows_its_birth(tmp_path):
    with mosquitto(tmp_path / "broker") as broker:
        async with gateway(tmp_path, door_of(broker.url)) as served:
            async with listening(broker.port) as host:
                await host.until(lambda: {each.device for each in host.of("DBIRTH")} == {"pump", "fan"})
            with broker.away():
                served.control.order("trip", drive="fan", code=4)
                await asyncio.sleep(1.0)
                served.control.order("power", drive="fan", state="off")
                await asyncio.sleep(2.0)
            async with listening(broker.port) as host:
                await host.until(lambda: host.of("DBIRTH"))
                assert {each.device for each in host.of("DBIRTH")} == {"pump"}
                await asyncio.sleep(3.0)
                file = next((tmp_path / "state").rglob("sparkplug-*.json"))
                assert "fan" in json.loads(file.read_text())["waiting"]
                assert not host.of("DDATA", device="fan")
                served.control.order("power", drive="fan", state="on")
                await host.until(
                    lambda: "fault" in [each for _, each in host.values("fan", "Status/State", historical=True)], 20
                )
                await host.until(lambda: "fan" not in json.loads(file.read_text())["waiting"], 20)


@awaited
async def test_hanging_broker_is_noticed_and_births_follow_its_return(tmp_path):
    with mosquitto(tmp_path / "broker") as broker:
        async with gateway(tmp_path, door_of(broker.url)), listening(broker.port) as host:
            await host.until(lambda: host.of("DBIRTH"))
            broker.process.send_signal(signal.SIGSTOP)
            await asyncio.sleep(8)
            broker.process.send_signal(signal.SIGCONT)
            began = time.monotonic()
            async with listening(broker.port) as again:
                await again.until(lambda: again.of("NBIRTH"), 20)
                assert time.monotonic() - began < 20
