"""Alarms of a running server: events, messages, acknowledgements, and restarts."""

import asyncio
import contextlib
import json
import os
import re
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from alarm_plant import AlarmPlant
from alarm_points import current, limit, pump, rule
from alarm_receivers import Hook

from drivecomm.errors import NotAllowedError, UsageError
from drivecomm.server import Caller, Role
from drivecomm.server.alarms import PlantAlarms
from drivecomm.server.alarms.delivery import DeliveryTiming

ANN = Caller(name="ann", role=Role.OPERATE, door="http 127.0.0.1:8080")
EVE = Caller(name="eve", role=Role.VIEW, door="http 127.0.0.1:8080")
QUICK = DeliveryTiming(within_s=1, first_s=0.05, longest_s=0.1, gather_s=0.02)


class Running:
    """Alarms of a plant in a separate thread with its own event loop, as in a server."""

    def __init__(self, file, *rules, session="run", state=None):
        self.events = []
        self.plant = AlarmPlant(session)
        self.plant.state = state or self.plant.state
        self.alarms = PlantAlarms(self.plant, rules, file=file, write_event=self.write, pace=QUICK, environment={})
        self.loop = asyncio.new_event_loop()
        self.thread = threading.Thread(target=self.run)
        self.thread.start()
        while not self.plant.read:
            time.sleep(0.001)

    def write(self, kind, text, *, drive="", who="", **_):
        self.events.append((kind, text, drive, who))

    def run(self):
        self.task = self.loop.create_task(self.alarms.run(self.plant, lambda: None))
        with contextlib.suppress(asyncio.CancelledError):
            self.loop.run_until_complete(self.task)
        self.loop.run_until_complete(self.loop.shutdown_default_executor())
        self.loop.close()

    def end(self):
        if self.thread.is_alive():
            self.loop.call_soon_threadsafe(self.task.cancel)
            self.thread.join()

    @property
    def texts(self):
        return [text for _, text, _, _ in self.events]


@pytest.fixture
def running(tmp_path):
    with contextlib.ExitStack() as stack:

        def start(*rules, **options):
            found = Running(tmp_path / "alarms.json", *rules, **options)
            stack.callback(found.end)
            return found

        yield start


@pytest.mark.soak
def test_alarm_from_trip_to_end_is_delivered_and_logged(running, hook, eventually):
    server = running(rule(over_s=0.3, deliver=(f"webhook:{hook.url}",)))
    server.plant.see(pump("F0400 overload"), "fault")
    (message,) = eventually(lambda: hook.got)
    (alarm,) = server.alarms.standing()
    (told,) = message["alarms"]
    assert told.pop("since").endswith("Z")
    assert told.pop("time").endswith("Z")
    assert told.pop("text").startswith("pump: pump fault: fault F0400 overload, since 20")
    assert told == {
        "message": "run-1.1", "what": "raised", "id": "run-1", "rule": "pump fault", "drive": "pump",
        "title": "pump fault: pump", "times": 1, "acknowledged_by": "",
    }  # fmt: skip
    server.alarms.acknowledge(ANN, alarm.id)
    server.plant.see(pump())
    eventually(lambda: hook.told == ["raised", "over"])
    assert hook.got[1]["alarms"][0]["id"] == "run-1"
    assert hook.got[1]["alarms"][0]["text"].startswith("pump: pump fault: over: fault F0400 overload, 20")
    assert hook.got[1]["alarms"][0]["acknowledged_by"] == "ann"
    over = server.events[-1][1]
    assert re.fullmatch(
        r"pump fault: over: fault F0400 overload, \d{4}-\d\d-\d\d [\d:]{8} to [-\d: ]+ \w+; now no fault", over
    )
    assert server.events == [
        ("alarm", "pump fault: fault F0400 overload", "pump", ""),
        ("alarm", "pump fault: acknowledged by ann (fault F0400 overload)", "pump", "ann (http 127.0.0.1:8080)"),
        ("alarm", over, "pump", ""),
    ]
    assert server.alarms.standing() == []


def test_conditions_present_at_the_start_or_missed_later_raise_alarms(running, eventually):
    server = running(rule(), limit(), state=pump("F1"))
    eventually(lambda: server.texts == ["pump fault: fault F1"])
    server.plant.all_values = [current("13")]
    server.plant.put()
    server.plant.read[0].lost = 5
    server.plant.put()
    eventually(lambda: "pump limit: output_current is 13 A, above 12.5 A" in server.texts)


@pytest.mark.soak
def test_delay_passes_without_new_values(running, eventually):
    server = running(limit(for_s=0.3))
    server.plant.put([current("13")])
    eventually(lambda: server.texts)


def test_acknowledging_needs_the_role_operate(running, eventually):
    server = running(rule(), state=pump("F1"))
    (alarm,) = eventually(server.alarms.standing)
    with pytest.raises(NotAllowedError, match=r"eve .* needs the role operate"):
        server.alarms.acknowledge(EVE, alarm.id)
    with pytest.raises(UsageError, match="no alarm 'x' stands"):
        server.alarms.acknowledge(ANN, "x")
    server.alarms.acknowledge(ANN, alarm.id)
    server.alarms.acknowledge(ANN, alarm.id)
    assert server.texts == ["pump fault: fault F1", "pump fault: acknowledged by ann (fault F1)"]


@pytest.mark.soak
def test_delivered_alarm_is_not_delivered_again_after_a_restart(running, hook, eventually, tmp_path):
    watched = rule(over_s=1.0, deliver=(f"webhook:{hook.url}",))
    server = running(watched, state=pump("F1"))
    eventually(lambda: hook.got)
    server.alarms.acknowledge(ANN, "run-1")
    server.end()
    assert server.plant.read[0].closed
    server = running(watched, session="later", state=pump("F1"))
    time.sleep(0.5)
    (alarm,) = server.alarms.standing()
    assert (alarm.id, alarm.acknowledged_by) == ("run-1", "ann")
    server.end()
    server = running(watched, session="last")
    eventually(lambda: hook.told == ["raised", "over"])
    server.end()
    assert json.loads((tmp_path / "alarms.json").read_text())["alarms"] == []


def test_undelivered_alarm_is_delivered_after_a_restart(running, hook, eventually, tmp_path):
    hook.does = 500
    watched = rule(deliver=(f"webhook:{hook.url}",))
    server = running(watched, state=pump("F1"))
    eventually(lambda: hook.begun)
    began = time.monotonic()
    server.end()
    assert time.monotonic() - began < 3
    assert "secret" not in (tmp_path / "alarms.json").read_text()
    hook.does = 200
    running(watched, session="later", state=pump("F1"))
    eventually(lambda: hook.told == ["raised"])
    assert hook.got[0]["alarms"][0]["message"] == "run-1.1"


@pytest.mark.soak
def test_alarm_is_stored_before_it_is_delivered(running, hook, eventually, tmp_path):
    found = []

    def look():
        found.append(json.loads((tmp_path / "alarms.json").read_text()))
        return ""

    server = running(rule(deliver=(f"webhook:{hook.url}",)))
    (queue,) = server.alarms._delivery._queues.values()
    queue._receiver = type("Looking", (), {"label": "", "deliver": lambda *_: look()})()
    server.plant.see(pump("F1"))
    eventually(lambda: found)
    assert [each["id"] for each in found[0]["alarms"]] == ["run-1"]
    assert [each["entry"]["message"] for each in found[0]["waiting"]] == ["run-1.1"]
    eventually(lambda: not json.loads((tmp_path / "alarms.json").read_text())["waiting"])


PROGRAM = """
import asyncio, sys
from pathlib import Path
from alarm_plant import AlarmPlant
from alarm_points import pump, rule
from drivecomm.server.alarms import PlantAlarms

plant = AlarmPlant()
plant.state = pump("F1")
watched = rule(deliver=(f"webhook:{sys.argv[2]}",))
alarms = PlantAlarms(plant, [watched], file=Path(sys.argv[1]), write_event=lambda *_, **__: None)
asyncio.run(alarms.run(plant, lambda: None))
"""


@pytest.mark.soak
@pytest.mark.parametrize("does", ["hang", 200])
def test_alarm_is_delivered_if_the_server_is_killed_during_or_after_delivery(running, hook, eventually, tmp_path, does):
    hook.does = does
    file = tmp_path / "alarms.json"
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parent)}
    with subprocess.Popen([sys.executable, "-c", PROGRAM, file, hook.url], env=environment) as process:
        eventually(lambda: hook.begun, 60)
        eventually(lambda: does == "hang" or not json.loads(file.read_text())["waiting"])
        process.kill()
    hook.does = 200
    server = running(rule(over_s=1.0, deliver=(f"webhook:{hook.url}",)), session="later", state=pump("F1"))
    eventually(lambda: hook.told)
    (alarm,) = server.alarms.standing()
    assert alarm.id == "run-1"
    server.plant.see(pump())
    eventually(lambda: hook.told == ["raised", "over"])
    assert hook.begun == 2 + (does == "hang")
    assert [each["message"] for message in hook.got for each in message["alarms"]] == ["run-1.1", "run-1.2"]


@pytest.mark.parametrize("content", ["", "{", "[]", '{"format": 1}', '{"format": 7}', '{"format": 1, "number": "x"}'])
def test_damaged_alarm_file_loses_no_present_alarm(running, eventually, tmp_path, content):
    (tmp_path / "alarms.json").write_text(content)
    server = running(rule(), state=pump("F1"))
    assert server.texts[0].startswith(
        "alarms before this start are unknown; their file was renamed to alarms.json.damaged"
    )
    eventually(lambda: "pump fault: fault F1" in server.texts)
    assert (tmp_path / "alarms.json.damaged").read_text() == content


@pytest.mark.soak
def test_unwritable_alarm_file_loses_no_alarm(running, hook, eventually, tmp_path):
    server = running(rule(over_s=0.3, deliver=(f"webhook:{hook.url}",)))
    (tmp_path / "alarms.json").mkdir()
    server.plant.see(pump("F1"))
    eventually(lambda: hook.told == ["raised"])
    server.plant.see(pump())
    eventually(lambda: hook.told == ["raised", "over"])
    assert sum(text.startswith("alarms would not survive a restart now: ") for text in server.texts) == 1
    (tmp_path / "alarms.json").rmdir()


@pytest.mark.soak
def test_changed_rules_end_alarms_and_raise_others(running, hook, eventually):
    server = running(rule(deliver=(f"webhook:{hook.url}",)), state=pump("F1", warning=True))
    eventually(lambda: hook.told == ["raised"])
    server.alarms.acknowledge(ANN, "run-1")
    with pytest.raises(UsageError, match="there is no secret"):
        server.alarms.change_rules([rule("warning", deliver=("@mail",))])
    with Hook() as other:
        server.alarms.change_rules([rule(), rule("warning", deliver=(f"webhook:{other.url}",))])
        eventually(lambda: other.told == ["raised"])
        server.alarms.change_rules([rule("warning", over_s=1.0, deliver=(f"webhook:{hook.url}",))])
        no_rule = "; now the plant file no longer has this alarm"
        eventually(lambda: any(text.endswith(no_rule) for text in server.texts))
        server.plant.see(pump())
        eventually(lambda: hook.told == ["raised", "over"])
        assert other.told == ["raised"]


@pytest.mark.soak
def test_alarms_can_be_run_again_after_a_failure(hook, tmp_path):
    """The supervisor of the server runs the alarms again after a failure."""
    hook.does = 500
    plant = AlarmPlant()
    plant.state = pump("F1")
    watched = [rule(deliver=(f"webhook:{hook.url}",))]
    alarms = PlantAlarms(plant, watched, file=tmp_path / "a", write_event=lambda *_, **__: None, pace=QUICK)

    async def some_time():
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(alarms.run(plant, lambda: None), 1)

    asyncio.run(some_time())
    assert hook.begun
    hook.does = 200
    asyncio.run(some_time())
    assert hook.told == ["raised"]


def test_drive_removed_from_the_plant_does_not_stop_alarms(running, eventually):
    server = running(rule())

    def gone(name):
        raise UsageError(f"no drive {name}")

    server.plant.drive = gone
    server.plant.see(pump("F1"))
    del server.plant.drive
    server.plant.see(pump("F2"))
    eventually(lambda: "pump fault: fault F2" in server.texts)


def test_missing_secret_is_refused_at_the_start(tmp_path):
    with pytest.raises(UsageError, match="there is no secret @mail"):
        PlantAlarms(AlarmPlant(), [rule(deliver=("@mail",))], file=tmp_path / "a", write_event=print, environment={})


def test_folder_of_the_alarm_file_is_created(tmp_path, hook):
    found = Running(tmp_path / "not yet" / "alarms.json", rule(deliver=(f"webhook:{hook.url}",)), state=pump("F1"))
    found.end()
    assert json.loads((tmp_path / "not yet" / "alarms.json").read_text())["alarms"]
    assert not any("would not survive" in text for text in found.texts)
