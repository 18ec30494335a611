"""The replace command: a new drive gets the approved settings, and a wrong drive gets nothing."""

import re
import shlex
from pathlib import Path

import pytest

import drivecomm
from drivecomm.errors import StateError
from drivecomm.virtual import virtual_drive

PLANT = """
format = 1
[[line]]
name = "hall"
port = "line"
[[drive]]
name = "fan"
drive = "danfoss-fc:3"
options = { model = "fc300" }
armed = true
[[drive]]
name = "pump"
drive = "vabus:1"
options = { model = "agile" }
armed = true
"""
OLD_SERIAL = "999999A111"


@pytest.fixture
def line(shell, tmp_path, monkeypatch):
    """Create a plant with baselines of former drives in the current folder; return a line with new drives."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("DRIVECOMM_PLANT", raising=False)
    Path("plant.toml").write_text(PLANT, encoding="utf-8")
    old = shell.line(virtual_drive("danfoss-fc", 3), virtual_drive("vabus", 1))
    old.drives[0].poke("3-41", 1234)
    old.drives[0].poke("3-42", 2345)
    old.drives[0].poke("8-03", 30)
    old.drives[1].poke("482[3]", 1500)
    for name in ("fan", "pump"):
        assert shell("baseline", "accept", name, "--by", "Anna", port=None) == 0
    edit_baseline("fan", lambda text: re.sub(r"012345G678", OLD_SERIAL, re.sub(r"0123456789\d+", "1", text)))
    return shell.line(virtual_drive("danfoss-fc", 3), virtual_drive("vabus", 1))


def edit_baseline(name, change):
    path = Path(f"baselines/{name}.toml")
    path.write_text(change(path.read_text(encoding="utf-8")), encoding="utf-8")


def replace(shell, *words):
    return shell("replace", *words, port=None)


def test_new_drive_gets_the_approved_settings_and_its_watchdog_last(shell, line):
    written = []
    line.monitors.append(lambda piece: written.append(piece.data) if piece.sender is None else None)
    assert replace(shell, "fan", "--yes") == 0, shell.out + shell.err
    assert f"fan  serial number, converter  {OLD_SERIAL} -> 012345G678" in shell.out.splitlines()
    assert line.drives[0].peek("3-41", 0.0) == 1234
    assert line.drives[0].peek("8-03", 0.0) == 30
    changes = [text.split()[1] for text in shell.out.splitlines() if " -> " in text][-2:]
    assert changes == ["3-42", "8-03"]
    last = shell.out.splitlines()[-1]
    assert "as approved; when the machine runs well: drivecomm baseline accept fan --why replaced" in last
    words = shlex.split(last.partition("drivecomm ")[2])
    assert shell(*words, "--by", "Anna", port=None) == 0
    assert shell("drift", "fan", port=None) == 0


def test_replace_writes_nothing_without_yes_or_a_terminal(shell, line):
    before = line.drives[0].peek("3-41", 0.0)
    assert replace(shell, "fan") == 1
    assert shell.out.splitlines()[-1] == "fan  nothing was written; --yes writes it"
    assert "3-41" in shell.out
    assert line.drives[0].peek("3-41", 0.0) == before
    assert replace(shell, "fan", "--json") == 1
    assert shell.objects[-1]["written"] == []


@pytest.mark.parametrize("said", [(), ("--plate-compared",)])
def test_drive_of_another_size_gets_nothing(said, shell, line):
    edit_baseline("fan", lambda text: text.replace('"4.0 kW"', '"7.5 kW"'))
    assert replace(shell, "fan", "--yes", *said) == 2
    assert "its power section is '4.0 kW', and '7.5 kW' in the approved set" in shell.err
    assert line.drives[0].peek("3-41", 0.0) != 1234


def test_drive_that_was_not_replaced_is_left_alone(shell, line):
    edit_baseline("fan", lambda text: text.replace(OLD_SERIAL, "012345G678"))
    edit_baseline("fan", lambda text: re.sub(r'("serial number, power card" = )"1"', r'\1"0123456789012345678"', text))
    assert replace(shell, "fan", "--yes") == 2
    assert "is still the drive whose settings were approved (serial number 012345G678)" in shell.err
    assert line.drives[0].peek("3-41", 0.0) != 1234


def test_drive_that_reports_no_type_needs_the_plate_compared_flag(shell, line):
    assert replace(shell, "pump", "--yes") == 2
    assert "does not report its type and size" in shell.err
    assert line.drives[1].peek("482[3]", 0.0) != "000005DC"
    assert replace(shell, "pump", "--yes", "--plate-compared") == 0, shell.out + shell.err
    assert line.drives[1].peek("482[3]", 0.0) == "000005DC"


def test_replace_lists_the_panel_settings_for_a_silent_drive(shell, line):
    line.power_off(line.drives[0])
    assert replace(shell, "fan", "--yes") == 4
    assert "8-31" in shell.out
    assert "set the new drive up at its panel as listed, and run this again" in shell.err
    assert "drivecomm scan line --protocol danfoss-fc --wide" in shell.err


def test_drive_with_a_running_motor_gets_nothing(shell, line):
    with drivecomm.open_bus(line.port) as bus:
        fan = bus.drive("danfoss-fc", 3, model="fc300")
        fan.set_reference(percent=10)
        fan.start()
    assert replace(shell, "fan", "--yes") == StateError.exit_code
    assert "the motor runs" in shell.err
    assert line.drives[0].peek("3-41", 0.0) != 1234


def test_interrupted_replacement_continues(shell, line):
    fan = line.drives[0]
    line.monitors.append(lambda _: line.power_off(fan) if fan.peek("3-42", 0.0) == 2345 else None)
    assert replace(shell, "fan", "--yes") == 4
    assert list(Path("baselines").glob("*.journal"))
    line.monitors.clear()
    line.power_on(fan)
    assert replace(shell, "fan", "--yes") == 0, shell.out + shell.err
    assert not list(Path("baselines").glob("*.journal"))
    assert [fan.peek(address, 0.0) for address in ("3-41", "3-42", "8-03")] == [1234, 2345, 30]


def test_drive_without_a_baseline_needs_a_backup_file(shell, line):
    assert line
    Path("baselines/fan.toml").rename("fan-before.toml")
    assert replace(shell, "fan", "--yes") == 2
    assert "name a file that drivecomm backup wrote" in shell.err
    assert replace(shell, "fan", "fan-before.toml", "--yes") == 0, shell.out + shell.err
    assert replace(shell, "danfoss-fc:3", "--yes") == 2
    assert replace(shell, "pump", "fan-before.toml", "--yes") == 2
    assert "this is the parameter set of danfoss-fc:3, and pump is vabus:1" in shell.err
