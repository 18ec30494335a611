"""Sites, areas and lines as topic levels: values, commands, Home Assistant, the fleet, and cleared topics."""

import asyncio
import json
from contextlib import asynccontextmanager
from dataclasses import replace

import pytest
from doors import listening, open_door
from mosquitto import mosquitto, needs_mosquitto, until
from served_core import PLANT, NoteBook, awaited, core_of, runs

from drivecomm.server.fleet import Fleet, FleetSubscription
from drivecomm.server.history import HistoryWriter
from drivecomm.server.history_service import HistoryService
from drivecomm.server.mqtt import mqtt_door, value_backfill
from drivecomm.tomlfile import TomlTable

pytestmark = [needs_mosquitto, pytest.mark.soak]

LEVELS = {"site": "Leeds", "area": "mixing hall", "line": ""}
PREFIX = "drivecomm/Leeds/mixing%20hall"
HELD = PLANT.replace('policy = "coast", watchdog_s = 2 }', 'policy = "hold" }\nnetwork = { mqtt = ["start"] }')


@asynccontextmanager
async def served(tmp_path, **more):
    """Yield a broker, a client, the core and the control of its drives, for a plant whose door has topic levels."""
    with mosquitto(tmp_path / "broker") as broker:
        async with (
            core_of(tmp_path, HELD, audit=NoteBook(), **more.pop("core", {})) as (core, control),
            open_door(core, broker, levels=LEVELS, role="operate", home_assistant="homeassistant", **more),
            listening(broker, PREFIX) as client,
        ):
            await until(lambda: client.session and core.drive("fan").reachability == "answers")
            yield broker, client, core, control


def last_payload(client, topic):
    """Return a list of the last payload received on a topic; an empty list if no payload was received."""
    return [each.payload for each in client.heard if each.topic == f"{PREFIX}/{topic}"][-1:]


@awaited
async def test_values_are_published_below_the_line_of_their_drive(tmp_path):
    async with served(tmp_path) as (_, client, core, _control):
        await until(lambda: (client.latest("yard/fan/output_frequency") or {}).get("quality") == "good")
        await until(lambda: client.latest("hall/pump/availability") == {"state": "online"})
        await until(lambda: client.latest("bridge/info"))
        told = {each["name"]: each["topic"] for each in client.latest("bridge/info")["drives"]}
        assert told["fan"] == f"{PREFIX}/yard/fan"
        door = mqtt_door(TomlTable({"levels": LEVELS}, "hall.toml"))
        assert door.address_of("hall", core.plant.drive("fan"), "status") == f"{PREFIX}/yard/fan/status"
        assert not any(each.topic.startswith(f"{PREFIX}/fan") for each in client.heard)


@awaited
async def test_commands_are_accepted_only_on_the_line_of_the_drive(tmp_path):
    async with served(tmp_path) as (_, client, core, control):
        refused = await client.ask("hall/fan", client.command("start"))
        assert (refused["outcome"], runs(control, "fan")) == ("refused", False)
        assert f"publish to {PREFIX}/yard/fan/command" in refused["error"]["text"]
        assert (await client.ask("yard/fan", client.command("start")))["outcome"] == "done"
        await until(lambda: runs(control, "fan"))
        assert next(each for each in core.audit.ended_with if each[:2] == ("fan", "start"))[2].startswith("refused")


@awaited
@pytest.mark.parametrize("topic", ["yard/fan", "hall/fan", "nowhere/fan"])
async def test_stop_on_any_line_stops_the_drive(tmp_path, topic):
    async with served(tmp_path) as (_, client, _core, control):
        await client.ask("yard/fan", client.command("start"))
        await until(lambda: runs(control, "fan"))
        assert (await client.ask(topic, {"id": "s"}, topic="stop"))["outcome"] == "done"
        await until(lambda: not runs(control, "fan"))


@awaited
async def test_response_to_a_stop_of_all_drives_is_not_read_as_a_stop(tmp_path):
    async with served(tmp_path) as (_, client, _core, _control):
        assert (await client.request("stop"))["outcome"] == "done"
        # A later message on the same connection is handled after the response of the stop.
        assert (await client.ask("yard/fan", client.command("status")))["outcome"] == "done"
        assert not client.payloads("bridge/response/response")


@awaited
async def test_topics_of_a_drive_are_cleared_when_it_moves_to_another_line(tmp_path):
    async with served(tmp_path) as (_, client, core, _control):
        for each in ("status", "output_frequency", "availability"):
            await until(lambda each=each: client.latest(f"hall/pump/{each}"))
        await until(lambda: "output_frequency" in str(client.latest("bridge/info")))
        drives = tuple(replace(each, line="yard") if each.name == "pump" else each for each in core.plant.drives)
        await core.changed(replace(core.plant, drives=drives))
        for each in ("status", "output_frequency", "availability"):
            await until(lambda each=each: last_payload(client, f"hall/pump/{each}") == [b""])
        await until(lambda: client.latest("yard/pump/availability"))


@awaited
async def test_discovery_uses_topics_with_levels(tmp_path):
    async with served(tmp_path) as (_, client, _core, _control):
        place = "homeassistant/device/"

        def told():
            of_fan = (each for each in client.heard if place in each.topic and b'"fan"' in each.payload)
            return [
                content
                for content in map(json.loads, (each.payload for each in of_fan))
                if "output_frequency" in content["components"]
            ]

        await until(told)
        assert told()[-1]["device"]["suggested_area"] == "mixing hall"
        assert told()[-1]["components"]["command_stop"]["command_topic"] == f"{PREFIX}/yard/fan/stop"
        assert told()[-1]["availability"][1]["topic"] == f"{PREFIX}/yard/fan/availability"


@awaited
async def test_missed_values_are_published_below_the_levels(tmp_path, monkeypatch):
    monkeypatch.setattr(value_backfill, "LOOKED_EVERY_S", 0.1)
    file = tmp_path / "history.sqlite"
    journal = HistoryWriter(file)
    try:
        async with served(tmp_path, core={"journal": journal}, history=HistoryService(file)) as (
            broker,
            client,
            _core,
            _control,
        ):
            await until(lambda: client.latest("yard/fan/output_frequency"))
            before = journal.written
            with broker.away():
                await until(lambda: journal.written > before + 20)
            async with listening(broker, PREFIX) as again:
                await until(lambda: again.payloads("bridge/historical"), 20)
    finally:
        journal.close()


@awaited
async def test_fleet_shows_plants_at_any_depth(tmp_path):
    async with (
        served(tmp_path) as (broker, client, core, _control),
        open_door(core, broker, name="mill"),
        open_door(core, broker, levels={"line": ""}, name="kiln"),
    ):
        await until(lambda: client.latest("yard/fan/status"))
        fleet = Fleet()
        running = asyncio.create_task(FleetSubscription(client.settings, fleet).run())
        try:
            for name in ("Leeds/mixing hall", "mill", "kiln"):
                await until(lambda name=name: name in fleet.plants and fleet.plants[name].summary.answering == 3)
                assert fleet.plants[name].drives["fan"].state
        finally:
            running.cancel()
        assert set(fleet.plants) == {"Leeds/mixing hall", "mill", "kiln"}
