"""Stops despite errors beside them: in a model, an option, an entry or the whole of a plant file."""

import re

import pytest
from running_plant import PLANT, motors

from drivecomm.bus import Drive
from drivecomm.virtual import virtual_drive


def test_error_of_one_drive_does_not_prevent_the_stop_of_others(shell, plant, monkeypatch):
    path, lines, _ = plant
    stop = Drive.stop

    def fall(drive, how):
        if drive.name == "vabus:1":
            raise ZeroDivisionError("no such thing")
        stop(drive, how)

    monkeypatch.setattr(Drive, "stop", fall)
    assert shell("stop", "--all", "--plant", str(path), port=None) == 5
    assert "hall: pump has not confirmed its stop: no such thing" in shell.err
    assert shell.out.count("confirmed") == 3
    assert motors(lines)[1:] == [False] * 3


@pytest.mark.parametrize("option", ['model = "nowhere.toml"', 'model = "nonsense"', "model = 5", "nonsense = 1"])
def test_stop_all_leaves_invalid_options_out(shell, plant, option):
    path, lines, _ = plant
    path.write_text(PLANT.replace('model = "agile"', option), encoding="utf-8")
    assert shell("stop", "--all", "--plant", str(path), port=None) == 0
    assert "hall: pump  stop (ramp) confirmed, without its options: " in shell.out
    assert motors(lines) == [False] * 4


def test_stop_of_one_drive_leaves_invalid_options_out(shell, plant):
    path, lines, _ = plant
    path.write_text(PLANT.replace('model = "agile"', 'model = "nowhere.toml"'), encoding="utf-8")
    assert shell("stop", "pump", "--plant", str(path), port=None) == 0
    assert "pump  stop (ramp) commanded" in shell.out
    assert "without its options: nowhere.toml" in shell.err
    assert motors(lines)[0] is False
    assert shell("stop", "vabus:2", "--model", "nowhere.toml", port="hall") == 0
    assert shell("stop", "vabus:*", "--model", "nowhere.toml", port="hall") == 0


BROKEN = {
    "a key that is none": ("echo = true", "echo = true\necko = true"),
    "a value that cannot be": ('name = "spare"', 'name = "spare"\nbaudrate = "fast"'),
    "two of one name": ('name = "lift"', 'name = "pump"'),
    "options that are no table": ('options = { model = "agile" }', "options = 5"),
    "a line of text that cannot be read": ('options = { model = "agile" }', 'options = { model = "agile"'),
    "a table of its own": ('options = { model = "agile" }', '[drive.options]\nmodel = "agile"\n[drive.nonsense]'),
    "a fault that is none": ('name = "mill"', 'name = "mill"\n[[fault]]\nkind = "nonsense"\n[[drive]]'),
    "no format": ("format = 1", ""),
}


@pytest.mark.parametrize("what", BROKEN)
def test_stop_all_by_a_damaged_plant_file_stops_all_readable_drives(shell, plant, what):
    path, lines, _ = plant
    path.write_text(PLANT.replace(*BROKEN[what], 1), encoding="utf-8")
    assert shell("stop", "--all", "--plant", str(path), port=None) == 5
    assert motors(lines) == [False] * 4
    assert re.match(rf"drivecomm: {re.escape(str(path))}(, line \d+)?: ", shell.err)
    assert "stopping the drives that can still be read" in shell.err
    assert "hall: vlt3500:*  stop (ramp) sent to all" in shell.out
    assert "hall: vabus:*  stop (coast, because ramp is not supported) sent to all" in shell.out


@pytest.mark.parametrize("wrong", ['drive = "vabus:', 'drive = "vabus 2"', ""])
def test_unreadable_drive_is_named_and_stopped_by_a_broadcast(shell, plant, wrong):
    path, lines, _ = plant
    path.write_text(PLANT.replace('drive = "vabus:2"', wrong), encoding="utf-8")
    assert shell("stop", "--all", "--plant", str(path), port=None) == 5
    assert f"{path}: drive 2 (lift) cannot be read, so it is not stopped by itself" in shell.err
    assert shell.out.count("confirmed") == 3
    assert motors(lines) == [False] * 4


def test_drive_is_stopped_despite_an_error_elsewhere_in_the_plant_file(shell, plant):
    path, lines, _ = plant
    path.write_text(PLANT.replace('drive = "vabus:2"', 'drive = "vabus:'), encoding="utf-8")
    assert shell("stop", "mill", "--plant", str(path), port=None) == 0
    assert "mill  stop (ramp) commanded" in shell.out
    assert f"{path}: cannot be read as a plant" in shell.err
    assert motors({"yard": lines["yard"]}) == [False]
    assert shell("stop", "lift", "--plant", str(path), port=None) == 2
    assert f"{path}: cannot be read as a plant" in shell.err


@pytest.mark.parametrize(
    "text", [None, "", "rubbish", "format = 1", "[[drive]]\ndrive = 5", '[[drive]]\ndrive = "fuji:1"']
)
def test_given_port_is_stopped_if_the_plant_file_is_unreadable(shell, tmp_path, text):
    line = shell.line(virtual_drive("vabus", 1))
    assert shell("start", "vabus:1", "--link-loss", "hold") == 0
    path = tmp_path / "plant.toml"
    if text is not None:
        path.write_text(text, encoding="utf-8")
    assert shell("stop", "--all", "--plant", str(path), port=None) == 2
    assert shell.err.count("\n") == 1
    assert shell("stop", "--all", "--plant", str(path)) == 2
    assert "vabus:*  stop (coast, because ramp is not supported) sent to all" in shell.out
    assert motors({"line": line}) == [False]
