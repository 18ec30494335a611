"""Groups of drives in commands: those for several drives take them, those for one drive refuse them."""

from pathlib import Path

import pytest

from drivecomm.plant import read_plant
from drivecomm.virtual import VirtualPlant

PLANT = """
format = 1

[[line]]
name = "hall"
port = "HALL"

[[line]]
name = "yard"
port = "YARD"
echo = true

[[drive]]
name = "pump"
groups = ["wet", "hall 2"]
drive = "vabus:1"
line = "hall"
options = { model = "agile" }
armed = true
poll = [{ parameters = ["480"], period_s = 0 }]

[[drive]]
name = "fan"
groups = ["hall 2"]
drive = "danfoss-fc:3"
line = "hall"
options = { model = "fc300" }
armed = true

[[drive]]
name = "mixer"
groups = ["wet"]
drive = "fuji:2"
line = "yard"
armed = true

[[fault]]
drive = "fan"
trip = { code = 14, at_s = 9000 }
"""


@pytest.fixture
def plant(shell, tmp_path, monkeypatch):
    """A plant file with groups in this folder, and its lines as ports of the shell; gives what is sent on them."""
    monkeypatch.delenv("DRIVECOMM_PLANT", raising=False)
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "plant.toml"
    path.write_text(PLANT, encoding="utf-8")
    virtual = VirtualPlant(read_plant(path))
    virtual.sent = []
    for name in ("hall", "yard"):
        line = shell.lines[name.upper()] = virtual.line(name)
        line.monitors.append(lambda sent, name=name: virtual.sent.append((name, sent.data)))
    return virtual


def run(shell, *words):
    return shell(*words, port=None)


FOR_ONE_DRIVE = [
    ("start", "--link-loss", "hold"),
    ("start", "--link-loss", "trip", "--arm"),
    ("read", "480"),
    ("write", "480", "5"),
    ("call", "jog", "--link-loss", "hold"),
    ("reset",),
    ("reference", "10%"),
    ("wait", "ready"),
    ("tune",),
    ("prove", "--write", "proof.toml"),
    ("backup", "kept.toml"),
    ("restore", "kept.toml", "--dry-run"),
    ("compare", "factory"),
    ("baseline accept",),
    ("models grow", "--write", "grown.toml"),
]


@pytest.mark.parametrize("command", FOR_ONE_DRIVE, ids=" ".join)
@pytest.mark.parametrize("group", ["wet", "hall 2", "wet,reply_timeout_s=1"])
def test_command_for_one_drive_refuses_a_group_and_sends_nothing(shell, plant, command, group):
    words, *further = command
    if words == "restore":
        assert run(shell, "backup", "pump", "kept.toml") == 0
    files = sorted(Path().iterdir())
    plant.sent.clear()
    assert run(shell, *words.split(), group, *further) == 2
    name = group.partition(",")[0]
    drives = {"wet": "pump, mixer", "hall 2": "pump, fan"}[name]
    assert f"plant.toml: {name!r} is a group, of {drives}; name one of its drives" in shell.err
    assert shell.err.count("\n") == 1
    assert plant.sent == []
    assert sorted(Path().iterdir()) == files


def test_start_refuses_a_group_of_a_single_drive(shell, plant):
    path = Path("plant.toml")
    path.write_text(PLANT.replace('groups = ["wet"]', 'groups = ["alone"]'), encoding="utf-8")
    assert run(shell, "start", "alone", "--link-loss", "hold") == 2
    assert "'alone' is a group, of mixer; name one of its drives" in shell.err
    assert run(shell, "start", "mixer", "wet", "--link-loss", "hold") == 2
    assert plant.sent == []
