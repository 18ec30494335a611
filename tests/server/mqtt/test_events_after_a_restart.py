"""Commands and events of a killed server are published by the next one; the plant file is identified by its hash."""

import os
import signal
from hashlib import sha256

import pytest
from doors import listening
from mosquitto import mosquitto, needs_mosquitto, until
from processes import QUICK, serving
from served_core import awaited

from drivecomm.server.history import History

HISTORY = QUICK + 'history = {{ file = "{file}" }}\n'
DOOR = '[[door]]\nkind = "mqtt"\nbroker = "mqtt://127.0.0.1:{port}"\nprefix = "drivecomm/hall"\n'

pytestmark = [needs_mosquitto, pytest.mark.skipif(os.name != "posix", reason="signals and unix sockets are POSIX's")]


def is_in_the_history(folder):
    with History(folder / "kept.sqlite") as history:
        return history.commands() and any(each.event.kind == "command" for each in history.events())


@awaited
async def test_events_without_a_broker_are_published_after_a_server_restart(tmp_path):
    with (
        mosquitto(tmp_path / "broker") as broker,
        serving(
            tmp_path, head=HISTORY.format(file=tmp_path / "kept.sqlite"), tail=DOOR.format(port=broker.port)
        ) as one,
    ):
        async with listening(broker) as client:
            await until(lambda: client.latest("bridge/info"))
            file = client.latest("bridge/info")["file"]
            assert (file["name"], file["sha256"]) == ("plant.toml", sha256(one.plant.read_bytes()).hexdigest())
        with broker.away():
            one.until(lambda: one.drive("fan")["reachability"] == "answers")
            answer = one.ask("/api/v1/drives/fan/reset", {"id": "reset 1"})
            assert answer["outcome"] == "done", answer
            one.until(lambda: one.events("command"))
            event = one.events("command")[-1]
            one.until(lambda: is_in_the_history(tmp_path))
            one.end(signal.SIGKILL)
        async with listening(broker) as client:
            one.start()
            await until(lambda: any(each["kind"] == "command" for each in client.payloads("bridge/event")), 20)
            (late,) = [each for each in client.payloads("bridge/event") if each["kind"] == "command"]
            assert late["historical"] is True
            assert (late["number"], late["text"]) == (event["number"], event["text"])
            await until(lambda: client.payloads("bridge/audit"))
            (audit,) = client.payloads("bridge/audit")
            (command,) = [each for each in audit["commands"] if each["id"] == "reset 1"]
            assert (command["drive"], command["verb"], command["outcome"]) == ("fan", "reset", "done")
