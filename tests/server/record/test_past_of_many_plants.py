"""The record of a plant with a real server: its history and alarms are shown, and alarms acknowledged."""

import json
import os
import time

import pytest
from mosquitto import mosquitto, needs_mosquitto
from postgres import needs_postgres, postgres
from recorders import FileRecord, recording, until
from running_server import running_server
from served_core import simulated

from drivecomm.cli import main
from drivecomm.plant import read_plant
from drivecomm.server import Role, User, add_user, token_hash

PLANT = """
format = 1
[server]
name = "Mill north"
status_period_s = 0.1
{users}
[[alarm]]
name = "tripped"
on = "fault"
[[door]]
kind = "mqtt"
broker = "{url}"
{role}
[[line]]
name = "hall"
listen = "pty:{folder}/hall"
paced = false
[[drive]]
name = "pump"
drive = "vabus:1"
options = {{ model = "agile" }}
poll = [{{ parameters = ["output_frequency"], period_s = 0.1 }}]
"""

pytestmark = [
    needs_mosquitto,
    pytest.mark.soak,
    pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals are POSIX"),
]


@pytest.fixture(autouse=True)
def own_state(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


@pytest.fixture
def broker(tmp_path):
    with mosquitto(tmp_path / "broker") as running:
        yield running


@pytest.fixture(params=["file", pytest.param("postgres", marks=needs_postgres)])
def record(request, tmp_path):
    if request.param == "file":
        yield FileRecord(tmp_path)
    else:
        with postgres() as running:
            yield running


@pytest.fixture
def run(capsys):
    def run(*arguments):
        capsys.readouterr()
        code = main(["fleet", *arguments])
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return run


def plant_file(folder, broker, *, role='role = "operate"', users=""):
    file = folder / "plant.toml"
    file.write_text(PLANT.format(folder=folder, url=broker.url, role=role, users=users))
    return file


def test_history_and_alarms_of_a_plant_are_shown_from_its_record(tmp_path, broker, record, run):
    file = plant_file(tmp_path, broker)
    with (
        recording(broker.url, record.url),
        simulated(read_plant(file)) as (_, control),
        running_server(file),
    ):

        def shown(*arguments):
            code, out, _ = run(*arguments, "--from", record.url, "--json")
            return code, [json.loads(line) for line in out.splitlines()]

        def values():
            code, found = shown("history", "Mill north", "pump", "output_frequency", "--last", "5min")
            return len(found) > 5 and code == 0 and found

        until(values)
        first = values()[0]
        assert (first["drive"], float(first["value"]), first["unit"], first["quality"]) == ("pump", 0, "Hz", "good")
        assert abs(first["time_s"] - time.time()) < 60
        control.order("trip", drive="pump", code=5)
        until(lambda: shown("alarms")[0] == 5)
        ((alarm,),) = shown("alarms")[1:]
        assert (alarm["plant"], alarm["drive"], alarm["rule"], alarm["ended_s"]) == (
            "Mill north", "pump", "tripped", None,
        )  # fmt: skip
        events = shown("history", "Mill north", "--events")[1]
        assert alarm["id"] in {each["alarm"] for each in events}
        assert any(each["kind"] == "fault" and each["drive"] == "pump" for each in events)
        code, out, _ = run("acknowledge", broker.url, "Mill north", alarm["id"])
        assert code == 0
        assert "acknowledged by (broker)" in out
        until(lambda: shown("alarms")[0] == 0)
        assert shown("alarms", "Mill north")[1][0]["acknowledged_by"] == "(broker)"
        code, out, _ = run("alarms", "--from", record.url)
        assert (code, "Mill north" in out, "tripped" in out) == (0, True, True)
        for wrong, sentence in (
            (("history", "mill", "pump"), "no plant 'mill'"),
            (("history", "Mill north", "pumpe"), "no drive 'pumpe'"),
            (("history", "Mill north", "pump", "speed"), "no 'speed' of pump"),
        ):
            code, _, err = run(*wrong, "--from", record.url)
            assert code == 2
            assert sentence in err
        row = record.all("SELECT name, state, version, file FROM plant")[0]
        assert tuple(row)[:2] + tuple(row)[3:] == ("Mill north", "online", "plant.toml")


def test_acknowledging_through_the_broker_needs_the_role_operate(tmp_path, broker, run):
    users = tmp_path / "users.toml"
    tokens = {"anna": Role.VIEW, "otto": Role.OPERATE}
    file = plant_file(tmp_path, broker, role="", users='users = "users.toml"')
    for name, role in tokens.items():
        add_user(users, User(name=name, role=role, token=token_hash(f"the token of {name}")))
        (tmp_path / name).write_text(f"the token of {name}")
        (tmp_path / name).chmod(0o600)
    with simulated(read_plant(file)) as (_, control), running_server(file) as plant:
        control.order("trip", drive="pump", code=5)
        until(plant.alarms)
        alarm = plant.alarms()[0].id
        given = ("acknowledge", broker.url, "Mill north", alarm)
        until(lambda: "Mill north" in run(broker.url)[1])
        code, _, err = run(*given)
        assert (code, "send your token" in err) == (2, True)
        code, _, err = run(*given, "--token-file", str(tmp_path / "anna"))
        assert (code, "needs the role operate" in err) == (2, True)
        assert not plant.alarms()[0].acknowledged_by
        code, out, err = run(*given, "--token-file", str(tmp_path / "otto"))
        assert (code, "acknowledged by otto" in out) == (0, True), err
        assert plant.alarms()[0].acknowledged_by == "otto"
        code, _, err = run("acknowledge", broker.url, "quarry", alarm)
        assert (code, "no plant 'quarry'" in err) == (2, True)
