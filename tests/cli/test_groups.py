"""Groups of drives in commands: commands for several drives accept them, commands for one drive refuse them."""

from pathlib import Path

import pytest

from drivecomm.cli.line_options import LineArguments
from drivecomm.cli.watch.command import watched_lines
from drivecomm.errors import UsageError
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
options = { model = "g11s" }
armed = true

[[fault]]
drive = "fan"
trip = { code = 14, at_s = 9000 }
"""

OUTPUT = "output_frequency"


@pytest.fixture
def plant(shell, tmp_path, monkeypatch):
    """Create a plant file with groups in the current folder, and its lines as ports of the shell.

    Returns the virtual plant; its attribute `sent` collects each telegram with the name of its line.
    """
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


def test_status_of_a_group_shows_its_drives(shell, plant):
    assert run(shell, "status", "wet", "--json") == 0
    assert [(each["name"], each["line"]) for each in shell.objects] == [("pump", "hall"), ("mixer", "yard")]
    assert all(each["answers"] for each in shell.objects)
    assert run(shell, "status", "hall 2,reply_timeout_s=0.5") == 0
    assert [row.split()[0] for row in shell.out.splitlines()[1:3]] == ["pump", "fan"]
    assert run(shell, "status", "wet", "--model", "agile") == 2
    assert "--model is for one drive" in shell.err
    assert run(shell, "status", "hall 2", "--record", "heard.jsonl") == 0
    assert run(shell, "status", "wet", "--record", "again.jsonl") == 2
    assert "--record is for one line" in shell.err
    assert plant.sent


@pytest.mark.usefixtures("plant")
def test_unknown_group_is_refused_with_the_known_names(shell):
    for command in (("status",), ("stats",), ("drift",), ("baseline", "show"), ("stop",)):
        assert run(shell, *command, "wte") == 2
        assert "there is no drive 'wte' in this plant; did you mean 'wet'?" in shell.err
        assert "It has pump, fan, mixer, and the groups wet, hall 2" in shell.err


def test_poll_reads_the_parameters_after_a_group_from_each_of_its_drives(shell, plant):
    assert run(shell, "poll", "hall 2", OUTPUT, "pump", "480", "wet", OUTPUT, "--cycles", "1", "--json") == 0
    asked = sorted((each["drive"], each["parameter"]) for each in shell.objects)
    assert asked == [("fan", OUTPUT), ("mixer", OUTPUT), ("pump", "480"), ("pump", OUTPUT)]
    assert run(shell, "forecast", "hall 2", OUTPUT, "--json") == 0
    assert [each["drive"] for each in shell.objects[0]["items"]] == ["pump", "fan"]
    assert run(shell, "poll", "hall 2") == 2
    assert "no parameters given for hall 2; name them after it" in shell.err
    assert plant.sent


def test_stats_counts_the_drives_of_groups_once(shell, plant):
    assert run(shell, "stats", "wet", "vabus:1", "hall 2", "--for", "0.3", "--json") == 0
    assert [each["name"] for each in shell.objects if "name" in each] == ["pump", "fan", "mixer"]
    assert {line for line, _ in plant.sent} == {"hall", "yard"}


@pytest.mark.usefixtures("plant")
def test_drift_and_baseline_show_accept_a_group(shell):
    for name in ("pump", "fan"):
        assert run(shell, "baseline", "accept", name, "--by", "Anna") == 0
    assert run(shell, "baseline", "show", "hall 2", "--json") == 0
    assert [each["name"] for each in shell.objects] == ["pump", "fan"]
    assert run(shell, "baseline", "show", "wet", "--json") == 2
    assert shell.objects[-1]["without_baseline"] == ["mixer"]
    assert run(shell, "drift", "hall 2", "pump", "--json") == 0
    assert [each["name"] for each in shell.objects] == ["pump", "fan"]
    assert run(shell, "drift", "wet") == 2
    assert "without a baseline: mixer" in shell.out


def test_watched_lines_of_a_group_hold_only_its_drives(plant):
    options = LineArguments(plant=Path("plant.toml"), given=frozenset({"plant"}))
    hall, yard = watched_lines(["wet", "fan"], options)
    assert (hall.name, hall.port, [each.name for each in hall.drives]) == ("hall", "HALL", ["pump", "fan"])
    assert (yard.name, yard.port, [each.name for each in yard.drives]) == ("yard", "YARD", ["mixer"])
    assert yard.options == {"echo": "expect"}
    with pytest.raises(UsageError, match="--plant has no effect"):
        watched_lines(["plant.toml"], options)
    assert plant.sent == []
