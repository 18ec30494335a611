"""Alarms of a real server, listed and acknowledged at the command line."""

import json
import os

import pytest
from running_server import running_server
from served_core import simulated

from drivecomm.cli import main
from drivecomm.plant import read_plant
from drivecomm.server.backups import backing_up

pytestmark = pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals are POSIX")

PLANT = """
format = 1
[server]
name = "hall"
status_period_s = 0.1
[[alarm]]
name = "tripped"
on = "fault"
over_s = 1
[[line]]
name = "hall"
listen = "pty:{folder}/hall"
paced = false
[[drive]]
name = "pump"
drive = "vabus:1"
options = {{ model = "agile" }}
"""


def plant_file(tmp_path):
    file = tmp_path / "plant.toml"
    file.write_text(PLANT.format(folder=tmp_path))
    return file


@pytest.fixture(autouse=True)
def own_state(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


def test_alarms_are_listed_and_acknowledged_at_the_command_line(tmp_path, capsys, eventually):
    file = plant_file(tmp_path)

    def run(*words):
        code = main(["alarms", *words, "--plant", str(file)])
        output = capsys.readouterr()
        return code, output.out + output.err

    assert run("list")[0] == 2
    with simulated(read_plant(file)) as (_, control), running_server(file) as plant:
        assert run("list") == (0, "no alarms\n")
        control.order("trip", drive="pump", code=5)
        eventually(plant.alarms)
        code, listed = run("list", "--json")
        alarm = json.loads(listed)
        assert (code, alarm["state"], alarm["drive"], alarm["rule"]) == (0, "current", "pump", "tripped")
        assert f"{alarm['id']}  current       pump  tripped: fault " in run("list")[1]
        code, told = run("acknowledge", alarm["id"])
        assert code == 0
        assert "  acknowledged  pump  tripped: fault " in told
        assert json.loads(run("list", "--json")[1])["state"] == "acknowledged"
        code, told = run("acknowledge", "none-1")
        assert code == 2
        assert "no alarm 'none-1' stands" in told


def test_alarm_that_is_over_is_listed_with_its_cause(tmp_path, capsys, eventually):
    file = plant_file(tmp_path)
    with simulated(read_plant(file)) as (_, control), running_server(file) as plant:
        control.order("trip", drive="pump", code=5)
        eventually(plant.alarms)
        control.order("power", drive="pump", state="off")
        control.order("power", drive="pump", state="on")
        eventually(lambda: plant.alarms()[0].over_s)
        assert main(["alarms", "list", "--plant", str(file)]) == 0
        out = capsys.readouterr().out
        assert "  over          pump  tripped: fault " in out
        assert ", over at " in out


@pytest.mark.soak
def test_change_since_the_baseline_is_listed_until_it_is_approved(tmp_path, capsys, eventually, monkeypatch):
    monkeypatch.setattr(backing_up, "QUIET_S", 0.0)
    file = plant_file(tmp_path)
    of_server = '[server]\nbackup = { every = "1 s", share = 1 }'
    text = file.read_text().replace("[server]", of_server).replace('"tripped"', '"changed"')
    file.write_text(text.replace('on = "fault"', 'on = "changed_since_baseline"'))
    with simulated(read_plant(file)) as (_, control), running_server(file) as plant:
        assert main(["baseline", "accept", "pump", "--by", "Anna", "--plant", str(file)]) == 0
        eventually(lambda: plant.drive("pump").drift.state == "as approved")
        control.order("set", drive="pump", parameter="482[1]", value=1100)
        (alarm,) = eventually(plant.alarms)
        assert alarm.text.startswith("1 parameter differs from the baseline since 20")
        assert main(["alarms", "list", "--plant", str(file)]) == 0
        assert "pump  changed: 1 parameter differs" in capsys.readouterr().out
        assert main(["baseline", "accept", "pump", "--by", "Ben", "--plant", str(file)]) == 0
        eventually(lambda: plant.alarms()[0].over_s)


def test_alarm_on_a_change_of_a_drive_that_is_not_backed_up_is_refused(tmp_path, capsys):
    file = plant_file(tmp_path)
    file.write_text(file.read_text().replace('on = "fault"', 'on = "changed_since_baseline"'))
    assert main(["alarms", "check", str(file)]) == 2
    assert "the server does not back pump up" in capsys.readouterr().err
