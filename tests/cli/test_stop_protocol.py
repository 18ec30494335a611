"""stop PROTOCOL:* with a plant: its drives on all lines confirm their stop; other protocols keep running."""

import pytest
from running_plant import motors

from drivecomm.virtual import virtual_drive

PLANT = """
format = 1
[[line]]
name = "hall"
port = "hall"
[[line]]
name = "yard"
port = "yard"
[[line]]
name = "spare"
port = "spare"
[[drive]]
name = "fan"
drive = "danfoss-fc:3"
line = "hall"
[[drive]]
name = "mill"
drive = "fuji:7"
line = "hall"
[[drive]]
name = "mixer"
drive = "danfoss-fc:5"
line = "yard"
"""


@pytest.fixture
def two_lines(shell, tmp_path):
    """Start the drives of two lines; return the plant file and the lines."""
    lines = {
        "hall": shell.line(virtual_drive("danfoss-fc", 3), virtual_drive("fuji", 7), name="hall"),
        "yard": shell.line(virtual_drive("danfoss-fc", 5), name="yard"),
    }
    for name, port in (("danfoss-fc:3", "hall"), ("fuji:7", "hall"), ("danfoss-fc:5", "yard")):
        assert shell("start", name, "--link-loss", "hold", port=port) == 0
        lines[port].advance(20)
    path = tmp_path / "plant.toml"
    path.write_text(PLANT, encoding="utf-8")
    return path, lines


def test_stop_of_a_protocol_stops_its_drives_on_all_lines_and_no_other(shell, two_lines):
    path, lines = two_lines
    assert shell("stop", "danfoss-fc:*", "--plant", str(path), port=None) == 0
    assert sorted(shell.out.splitlines()) == [
        "hall: danfoss-fc:*  stop (ramp) sent to all",
        "hall: fan  stop (ramp) confirmed",
        "yard: danfoss-fc:*  stop (ramp) sent to all",
        "yard: mixer  stop (ramp) confirmed",
    ]
    assert motors(lines) == [False, True, False]


def test_plant_of_the_current_folder_outranks_a_port_of_the_environment(shell, two_lines, monkeypatch):
    path, lines = two_lines
    monkeypatch.chdir(path.parent)
    monkeypatch.setenv("DRIVECOMM_PORT", "hall")
    assert shell("stop", "danfoss-fc:*", port=None) == 0
    assert motors(lines) == [False, True, False]


def test_given_port_limits_the_stop_to_its_line(shell, two_lines):
    path, lines = two_lines
    assert shell("stop", "danfoss-fc:*", "--plant", str(path), port="yard") == 0
    assert shell.out == "danfoss-fc:*  stop (ramp) sent to all; no drive confirms a broadcast\n"
    assert motors(lines) == [True, True, False]


def test_missing_port_does_not_prevent_the_stop_of_other_lines(shell, two_lines):
    path, lines = two_lines
    hall = shell.lines.pop("hall")
    assert shell("stop", "danfoss-fc:*", "--plant", str(path), port=None) == 5
    assert "hall: fan has not confirmed its stop: port hall does not exist" in shell.err
    assert motors({"hall": hall, "yard": lines["yard"]}) == [True, True, False]


def test_damaged_plant_file_stops_readable_drives_and_broadcasts_on_each_line(shell, two_lines):
    path, lines = two_lines
    path.write_text(PLANT.replace('drive = "danfoss-fc:5"', "drive = danfoss-fc:5"), encoding="utf-8")
    assert shell("stop", "danfoss-fc:*", "--plant", str(path), port=None) == 5
    assert "yard: danfoss-fc:*  stop (ramp) sent to all" in shell.out
    assert motors(lines) == [False, True, False]


def test_protocol_without_drives_in_the_plant_is_stopped_by_broadcasts(shell, two_lines):
    path, lines = two_lines
    # The plant file may be out of date.
    path.write_text(
        PLANT.replace('name = "mill"\ndrive = "fuji:7"', 'name = "mill"\ndrive = "vabus:7"'), encoding="utf-8"
    )
    assert shell("stop", "fuji:*", "--plant", str(path), port=None) == 5
    assert "hall: fuji:*  stop (ramp) sent to all" in shell.out
    assert "yard: fuji:*  stop (ramp) sent to all" in shell.out
    assert motors(lines) == [True, False, True]


@pytest.mark.parametrize("port", [None, "hall"])
def test_misspelt_protocol_gets_a_suggestion(shell, two_lines, port):
    path, _ = two_lines
    assert shell("stop", "danfos-fc:*", "--plant", str(path), port=port) == 2
    assert shell.err.startswith("drivecomm: no installed protocol is named 'danfos-fc'; did you mean 'danfoss-fc'?")


def test_stop_of_a_protocol_prints_json(shell, two_lines):
    path, _ = two_lines
    assert shell("stop", "danfoss-fc:*", "--plant", str(path), "--how", "coast", "--json", port=None) == 0
    assert {each["drive"] for each in shell.objects if each["confirmed"]} == {"fan", "mixer"}
