"""The baseline and drift commands."""

import shlex
from pathlib import Path

import pytest

from drivecomm.virtual import virtual_drive

PLANT = """
format = 1
[[line]]
name = "hall"
port = "line"
[[drive]]
name = "pump"
drive = "vabus:1"
options = { model = "agile" }
[[drive]]
name = "Fan 2"
drive = "danfoss-fc:3"
options = { model = "fc300" }
[[drive]]
name = "lift"
drive = "vabus:2"
"""


@pytest.fixture
def line(shell, tmp_path, monkeypatch):
    """Create a plant of three drives in the current folder, two of them with a baseline; return its virtual line."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("DRIVECOMM_PLANT", raising=False)
    Path("plant.toml").write_text(PLANT, encoding="utf-8")
    made = shell.line(virtual_drive("vabus", 1), virtual_drive("danfoss-fc", 3), virtual_drive("vabus", 2))
    for name in ("pump", "Fan 2"):
        assert shell("baseline", "accept", name, "--by", "Anna", "--why", "ran well", port=None) == 0
    return made


def run(shell, *words):
    return shell(*words, port=None)


def test_accept_prints_the_approved_parameters_and_the_file(shell, line):
    assert line
    assert shell.out.splitlines()[-1].endswith("parameters approved, in baselines/Fan%202~1.toml")
    assert sorted(path.name for path in Path("baselines").iterdir()) == ["Fan%202~1.toml", "pump.toml"]


@pytest.mark.usefixtures("line")
def test_baseline_file_serves_compare_and_restore_but_not_backup(shell):
    assert run(shell, "compare", "pump", "baselines/pump.toml") == 0
    assert run(shell, "restore", "pump", "baselines/pump.toml", "--dry-run", "--arm") == 0
    assert run(shell, "backup", "pump", "baselines/pump.toml") == 2
    assert "only drivecomm baseline accept replaces" in shell.err


@pytest.mark.usefixtures("line")
def test_baseline_show_lists_approvers_and_reasons(shell):
    assert run(shell, "baseline", "show") == 0
    pump, fan, rest = shell.out.splitlines()
    assert pump.startswith("pump ")
    assert " Anna " in pump
    assert pump.endswith("UTC  ran well")
    assert fan.startswith("Fan 2 ")
    assert rest == "without a baseline: lift; make one: drivecomm baseline accept lift"
    assert run(shell, "baseline", "show", "pump", "--json") == 0
    assert [(each["drive_name"], each["by"], each["why"]) for each in shell.objects] == [("pump", "Anna", "ran well")]
    assert run(shell, "baseline", "show", "lift") == 2


def test_drift_lists_differences_and_drives_without_a_baseline(shell, line):
    assert run(shell, "drift") == 0
    assert [text.split("  ")[0] for text in shell.out.splitlines()[:-1]] == ["pump", "Fan 2"]
    assert shell.out.splitlines()[0].startswith("pump  0 changed, ")
    assert shell.out.splitlines()[-1] == "without a baseline: lift; make one: drivecomm baseline accept lift"
    line.drives[0].poke("482[3]", 1500)
    assert run(shell, "drift") == 1
    assert shell.out.splitlines()[0] == "pump  482[3] fixed_frequency_3  25.00 Hz -> 15.00 Hz"
    assert shell.out.splitlines()[1].startswith("pump  1 changed, 75 as approved by Anna on ")
    assert run(shell, "drift", "Fan 2") == 0
    assert "482" not in shell.out


def test_drift_prints_json(shell, line):
    line.drives[0].poke("482[3]", 1500)
    assert run(shell, "drift", "--json") == 1
    change, pump, fan, rest = shell.objects
    assert (change["kind"], change["drive_name"], change["parameter"]) == ("changed", "pump", "482[3]")
    assert (change["quantity"], change["approved"]["value"], change["now"]["value"], change["now"]["unit"]) == (
        "fixed_frequency_3", "25.00", "15.00", "Hz",
    )  # fmt: skip
    assert (pump["same"], pump["changed"], fan["same"], fan["changed"]) == (False, 1, True, 0)
    assert rest["without_baseline"] == ["lift"]


def test_silent_drive_does_not_hide_the_drift_of_others(shell, line):
    line.drives[1].poke("3-41", 1234)
    line.power_off(line.drives[0])
    assert run(shell, "drift") == 4
    assert "3-41 ramp_1_up_time" in shell.out
    assert "pump" in shell.err
    assert run(shell, "drift", "--json") == 4
    assert [each["exit_code"] for each in shell.objects if "error" in each] == [4]


def test_drift_gives_up_a_silent_drive_after_the_first_request(shell, line):
    line.power_off(line.drives[0])
    heard = []
    line.monitors.append(lambda sent: heard.append(sent.data))
    assert run(shell, "status", "pump") == 4
    asked, heard[:] = len(heard), []
    assert run(shell, "drift", "pump") == 4
    assert 0 < len(heard) <= asked


def test_damaged_baseline_does_not_hide_the_drift_of_others(shell, line):
    Path("baselines/pump.toml").write_text("format = 1\n", encoding="utf-8")
    line.drives[1].poke("3-41", 1234)
    assert run(shell, "drift") == 2
    assert "baselines/pump.toml" in shell.err
    assert "3-41 ramp_1_up_time" in shell.out
    assert run(shell, "baseline", "show") == 2
    assert "Fan 2" in shell.out


def test_replaced_drive_is_reported_with_the_command_that_restores_it(shell, line):
    line.drives[1].poke("3-41", 1234)
    path = Path("baselines/Fan%202~1.toml")
    text = path.read_text(encoding="utf-8")
    key, value = text.partition("[identity]\n")[2].splitlines()[0].split(" = ")
    path.write_text(text.replace(f"{key} = {value}", f'{key} = "another"'), encoding="utf-8")
    assert run(shell, "drift", "Fan 2") == 1
    told, how = shell.out.splitlines()
    assert told.startswith("Fan 2  replaced, the approved set is of another drive: its ")
    assert told.endswith("; 1 of its settings differ, " + told.rpartition(", ")[2])
    words = shlex.split(how.partition("drivecomm ")[2])
    assert words == ["restore", "Fan 2", str(path), "--another-drive", "--arm"]
    assert run(shell, *words) == 0
    assert "1 written and stored" in shell.out
    assert run(shell, "drift", "Fan 2", "--json") == 1
    assert (shell.objects[-1]["changed"], bool(shell.objects[-1]["replaced"])) == (0, True)
    assert run(shell, "baseline", "accept", "Fan 2") == 0
    assert "the previous set was of another drive" in shell.out
    assert run(shell, "drift", "Fan 2") == 0


def test_accept_shows_changes_against_the_earlier_baseline(shell, line):
    line.drives[0].poke("482[3]", 1500)
    assert run(shell, "baseline", "accept", "pump", "--by", "Ben") == 0
    assert shell.out.splitlines()[0] == "pump  482[3] fixed_frequency_3  25.00 Hz -> 15.00 Hz"
    assert run(shell, "drift", "pump") == 0
    assert "by Ben on " in shell.out


def test_accept_from_a_file_sends_nothing(shell, line):
    assert run(shell, "backup", "pump", "pump.toml", "--all") == 0
    line.drives[0].poke("482[3]", 1500)
    assert run(shell, "baseline", "accept", "pump", "--from", "pump.toml") == 0
    assert "[measured]" not in Path("baselines/pump.toml").read_text(encoding="utf-8")
    assert run(shell, "drift", "pump") == 1
    assert run(shell, "baseline", "accept", "Fan 2", "--from", "pump.toml") == 2
    assert "this is the parameter set of vabus:1, and Fan 2 is danfoss-fc:3" in shell.err
    assert shell("baseline", "accept", "pump", "--from", "pump.toml", port="line") == 2
    assert "not from a drive, so --port has no effect" in shell.err


def test_accept_keeps_the_earlier_baseline_if_the_drive_falls_silent(shell, line):
    before = Path("baselines/pump.toml").read_bytes()
    line.call_at(line.time + 1.0, lambda: line.power_off(line.drives[0]))
    assert run(shell, "baseline", "accept", "pump") == 4
    assert Path("baselines/pump.toml").read_bytes() == before
    assert len(list(Path("baselines").iterdir())) == 2


@pytest.mark.usefixtures("line")
def test_drift_that_leaves_a_drive_unchecked_is_not_a_success(shell):
    assert run(shell, "drift", "pump", "lift") == 2
    assert shell.out.startswith("pump  0 changed")
    for path in Path("baselines").iterdir():
        path.unlink()
    assert run(shell, "drift") == 2
    assert "without a baseline: pump, Fan 2, lift; make one: drivecomm baseline accept pump" in shell.out
    assert run(shell, "drift", "nobody") == 2
    Path("plant.toml").unlink()
    assert run(shell, "drift") == 2
    assert "name one with --plant" in shell.err
    assert shell("baseline", "accept", "vabus:1") == 2
    assert "is not in a plant" in shell.err
