"""Commands over a real broker: old, repeated, retained or unauthorised ones move no motor, and a stop is always sent.

Each refusal is checked in three places: the response, the audit, and the virtual motor.
"""

import asyncio
import time
from contextlib import asynccontextmanager, suppress

import pytest
from doors import door_events, listening, open_door
from mosquitto import mosquitto, needs_mosquitto, until
from served_core import PLANT, NoteBook, awaited, core_of, runs

from drivecomm.protocol import Stop
from drivecomm.server.broker import BrokerMessage
from drivecomm.server.mqtt import commanding

pytestmark = needs_mosquitto

HELD = PLANT.replace('network = { http = ["start", "reference", "reset"], write = ["480"] }',
                     'network = { mqtt = ["start", "reference", "reset"], write = ["480"] }'
                     ).replace('policy = "coast", watchdog_s = 2 }',
                               'policy = "hold" }\nnetwork = { mqtt = ["start", "reference"] }')  # fmt: skip


@asynccontextmanager
async def commanded(tmp_path, *, version="5", **door):
    """Yield a client of a door, the core, the control of its drives, and its audit."""
    door = {"role": "operate", **door}
    notes = NoteBook()
    with mosquitto(tmp_path / "broker") as broker:
        async with (
            core_of(tmp_path, HELD, audit=notes) as (core, control),
            open_door(core, broker, version=version, **{k: v for k, v in door.items() if v is not None}),
            listening(broker) as client,
        ):
            await until(lambda: client.session and core.drive("fan").reachability == "answers")
            await until(lambda: core.drive("pump").reachability == "answers")
            client.broker = broker
            yield client, core, control, notes


def refused(notes, drive, verb):
    return [text for name, of, text in notes.ended_with if (name, of) == (drive, verb) and text.startswith("refused")]


@awaited
async def test_command_is_carried_out_and_answered(tmp_path):
    async with commanded(tmp_path) as (client, _core, control, notes):
        answer = await client.ask("fan", client.command("start"))
        assert (answer["outcome"], answer["id"], answer["error"]) == ("done", "c1", None)
        await until(lambda: runs(control, "fan"))
        assert ("(broker) (mqtt 127.0.0.1" in notes.asked_for[0][0], notes.asked_for[0][1:]) == (True, ("fan", "keep"))
        answer = await client.ask("fan", client.command("set_reference", arguments={"percent": 40}))
        assert answer["outcome"] == "done"
        assert (await client.ask("fan", client.command("stop")))["outcome"] == "done"
        await until(lambda: not runs(control, "fan"))


@pytest.mark.parametrize("arguments", [{"policy": "hold"}, {"watchdog_s": 600}])
@awaited
async def test_start_with_looser_policy_than_the_plant_file_is_refused(tmp_path, arguments):
    async with commanded(tmp_path) as (client, _core, control, notes):
        answer = await client.ask("pump", client.command("start", arguments=arguments))
        assert answer["outcome"] == "refused"
        assert 'allows policy = "trip" within 2 s or less' in answer["error"]["text"]
        assert "asks for" in refused(notes, "pump", "start")[0]
        assert not runs(control, "pump")


@awaited
async def test_standing_stop_is_published_and_one_by_message_does_not_stand(tmp_path):
    async with commanded(tmp_path) as (client, core, _control, _notes):
        assert (await client.ask("fan", client.command("stop")))["outcome"] == "done"
        assert core.drive("fan").standing_stop is None
        release = core.stop_demands.hold("fan", Stop.RAMP, "plc")
        said = {"state": "online", "standing_stop": "stop (ramp) demanded by plc"}
        await until(lambda: client.latest("fan/availability") == said)
        release()
        await until(lambda: client.latest("fan/availability") == {"state": "online"})


@pytest.mark.soak
@awaited
async def test_retained_start_is_refused_on_reconnect(tmp_path):
    async with commanded(tmp_path, version="3.1.1") as (client, core, control, notes):
        answer = await client.ask("fan", client.command("start"), retain=True)
        # In MQTT 3.1.1 a live message does not show its retain flag; the broker sends it again on each connection.
        assert answer["outcome"] == "done"
        assert (await client.ask("fan", "", topic="stop"))["outcome"] == "done"
        await until(lambda: not runs(control, "fan"))
        await client.cut()
        await until(lambda: any("retained command" in each for each in door_events(core)))
        assert len(refused(notes, "fan", "start")) == 1
        await asyncio.sleep(0.3)
        assert not runs(control, "fan")


@pytest.mark.soak
@awaited
async def test_start_with_the_session_before_a_reconnect_is_refused(tmp_path):
    async with commanded(tmp_path) as (client, _core, control, notes):
        old = client.command("start")
        # Each connection of the gateway has a new session.
        await client.cut()
        answer = await client.ask("fan", {**old, "issued_s": time.time()})
        assert answer["outcome"] == "refused"
        assert "earlier connection" in answer["error"]["text"]
        assert refused(notes, "fan", "start")
        assert not runs(control, "fan")
        assert (await client.ask("fan", client.command("start")))["outcome"] == "done"


@pytest.mark.soak
@awaited
async def test_stop_command_needs_no_session_and_ignores_the_command_limit(tmp_path, monkeypatch):
    async with commanded(tmp_path) as (client, _core, control, notes):
        assert (await client.ask("fan", client.command("start")))["outcome"] == "done"
        monkeypatch.setattr(commanding, "MOST_AT_ONCE", 0)
        answer = await client.ask("fan", client.command("set_reference", arguments={"percent": 40}))
        assert "commands are under way" in answer["error"]["text"]
        assert refused(notes, "fan", "set_reference")
        assert (await client.ask("fan", {"id": "halt", "verb": "stop"}))["outcome"] == "done"
        await until(lambda: not runs(control, "fan"))
        # A stop may be repeated, and its session may be old.
        assert (await client.ask("fan", {"id": "halt", "verb": "stop", "session": "old"}))["outcome"] == "done"
        assert refused(notes, "fan", "stop") == []


@pytest.mark.soak
@awaited
async def test_door_without_role_and_users_only_publishes(tmp_path):
    async with commanded(tmp_path, role=None) as (client, _core, control, _notes):
        assert client.latest("bridge/state")["commands"] is False
        await client.publish("fan/command", client.command("start"))
        await client.publish("fan/stop", "")
        await asyncio.sleep(0.5)
        assert client.payloads("fan/response") == []
        assert not runs(control, "fan")


@pytest.mark.parametrize(
    "payload", ["", "ramp", '{"how":"coast"}', '{"id":""}', "1", "ON", '"coast"', '{"reason":"belt torn"}', '{"how":']
)
@awaited
async def test_stop_needs_neither_session_nor_time(tmp_path, payload):
    async with commanded(tmp_path, role="view") as (client, _core, control, notes):
        answer = await client.ask("fan", payload, topic="stop")
        assert answer["outcome"] == "done"
        assert notes.stops == [("fan", "coast" if "coast" in payload else "ramp")]
        assert not runs(control, "fan")


@pytest.mark.soak
@pytest.mark.parametrize("version", ["5", "3.1.1"])
@awaited
async def test_retained_stop_is_sent_when_published_but_not_on_reconnect(tmp_path, version):
    async with commanded(tmp_path, version=version) as (client, core, _control, notes):
        await client.publish("fan/stop", "ramp", retain=True)
        await until(lambda: client.payloads("fan/response"))
        assert notes.stops == [("fan", "ramp")]
        if version == "5":
            await until(lambda: any("published as retained" in each for each in door_events(core)))
        stops = len(notes.stops)
        await client.cut()
        await asyncio.sleep(0.5)
        assert len(notes.stops) == stops


@pytest.mark.soak
@pytest.mark.parametrize("payload", ["", "quick", "STOP", '{"lines":5}'])
@awaited
async def test_stop_request_stops_all_drives(tmp_path, payload):
    async with commanded(tmp_path) as (client, _core, control, _notes):
        assert (await client.ask("fan", client.command("start")))["outcome"] == "done"
        await until(lambda: runs(control, "fan"))
        await client.publish("bridge/request/stop", payload)
        await until(lambda: client.payloads("bridge/response/stop"))
        stopped = client.latest("bridge/response/stop")["result"]
        assert {"pump", "fan", "mixer"} <= {each["drive"] for each in stopped}
        await until(lambda: not runs(control, "fan"))


@pytest.mark.soak
@awaited
async def test_motor_under_a_lease_stops_when_the_broker_is_gone(tmp_path):
    async with commanded(tmp_path) as (client, core, control, _notes):
        lease = await client.request("lease/take", drive="pump", seconds=2)
        key = lease["result"]["key"]
        answer = await client.ask("pump", client.command("start", lease=key))
        if answer["outcome"] != "done":
            pytest.fail(str(answer))
        await until(lambda: runs(control, "pump"))
        client.broker.end()
        # Without the broker the lease cannot be renewed.
        await until(lambda: not runs(control, "pump"), 10)
        assert core.kept.policy("pump") == ""


GARBAGE = [b"\xff\xfe", b"{", b"[]", b"7", b'{"verb":["start"]}', b'{"verb":"start","more":1}', b"{" * 5000,
           b"x" * 20000, b'{"id":"","verb":"explode","issued_s":1e999,"valid_s":-1,"session":"x"}']  # fmt: skip


@pytest.mark.soak
@awaited
async def test_garbage_is_refused_and_moves_no_motor(tmp_path):
    async with commanded(tmp_path) as (client, _core, control, notes):
        for garbage in GARBAGE:
            answer = await client.ask("fan", garbage)
            assert answer["outcome"] == "refused"
        assert len(refused(notes, "fan", "command")) >= 8
        assert not runs(control, "fan")
        for garbage in GARBAGE:
            before = len(client.payloads("bridge/response/lease/take"))
            await client.publish("bridge/request/lease/take", garbage)
            await until(lambda before=before: len(client.payloads("bridge/response/lease/take")) > before)
        assert (await client.request("explode"))["outcome"] == "refused"
        assert (await client.ask("nobody", client.command("start")))["outcome"] == "refused"
        assert (await client.ask("fan", client.command("status")))["outcome"] == "done"


@pytest.mark.soak
@awaited
async def test_flood_of_commands_is_ignored_and_a_stop_still_works(tmp_path, monkeypatch):
    monkeypatch.setattr(commanding, "PAUSE_S", 1.0)
    async with commanded(tmp_path) as (client, core, control, notes):
        assert (await client.ask("fan", client.command("start")))["outcome"] == "done"
        await until(lambda: runs(control, "fan"))
        before = len(notes.ended_with)
        flood = [
            client.connection.publish(BrokerMessage(topic="drivecomm/hall/fan/command", payload=f"x{number}", qos=0))
            for number in range(3000)
        ]
        await asyncio.gather(*flood)
        answer = asyncio.create_task(client.ask("fan", "coast", topic="stop"))
        await until(lambda: not runs(control, "fan"), 3)
        await answer
        await until(lambda: any("too many messages" in each for each in door_events(core)))
        # The audit and the events report the flood once, with the number of dropped messages.
        assert len(notes.ended_with) - before < 1000
        assert len(door_events(core)) == 1
        await until(lambda: any("messages to drivecomm/hall/+/command were discarded" in text
                                for _, _, text in notes.ended_with), 15)  # fmt: skip
        # On a slow machine the rest of the flood may begin another pause.
        for _ in range(5):
            with suppress(TimeoutError):
                async with asyncio.timeout(3):
                    assert (await client.ask("fan", client.command("status")))["outcome"] == "done"
                    break
        else:
            pytest.fail("commands are not heard again")


@awaited
async def test_response_topic_that_is_a_command_topic_is_ignored(tmp_path):
    async with commanded(tmp_path) as (client, _core, _control, _notes):
        await client.publish_for_answer("fan/command", client.command("status"), "drivecomm/hall/pump/command")
        await until(lambda: client.payloads("fan/response"))
        await client.publish_for_answer("fan/command", client.command("status"), "mine/answers")
        await until(lambda: any(each.topic == "mine/answers" for each in client.heard))
        assert not any(each.topic == "drivecomm/hall/pump/command" for each in client.heard)
