"""The tune command on virtual lines: finds the pause that a drive needs and writes it into the plant file."""

from itertools import count

import pytest

from drivecomm.cli import main
from drivecomm.plant import FaultPlan, LineFault, read_plant
from drivecomm.virtual import virtual_drive

PLANT = """format = 1

[[line]]
name = "hall"
port = "line"

[[drive]]
name = "pump"
drive = "vlt3500:5"
options = { baudrate = 115200 }   # as on its keypad

[[drive]]
name = "fan"
drive = "fuji:6"
"""


@pytest.fixture(autouse=True)
def line(shell):
    pump = virtual_drive("vlt3500", 5, baudrate=115200)
    pump.needs_pause_s = 0.001
    return shell.line(pump, virtual_drive("fuji", 6))


@pytest.fixture
def plant(tmp_path):
    file = tmp_path / "plant.toml"
    file.write_text(PLANT)
    return file


def test_tune_prints_the_pause_and_the_gain(shell):
    assert shell("tune", "vlt3500:5", "--baudrate", "115200") == 0
    first, second, third, last = shell.out.splitlines()
    assert first == "vlt3500:5  pause 10 ms -> 1.42 ms; 1.016 ms was enough"
    assert second.startswith("300 exchanges without an error; ")
    assert "times as many" in second
    assert third.startswith("replies begin after 10 ms to 10 ms; reply time-out 250 ms -> 100 ms")
    assert last == "options of the drive: tuned_turnaround_s = 0.00142, reply_timeout_s = 0.1"
    assert shell.err.startswith("drivecomm: this takes ")
    assert shell.err.endswith(" s at most\n")


def test_pause_that_the_maker_demands_stays(shell):
    assert shell("tune", "fuji:6", "--exchanges", "20") == 0
    assert "fuji:6  pause 10 ms stays: the maker requires it of some models; name the drive's --model\n" in shell.out
    assert "options of the drive" not in shell.out
    assert shell("tune", "fuji:6", "--model", "e11s", "--exchanges", "20") == 0
    assert "fuji:6  pause 10 ms stays: the maker requires it\n" in shell.out


def test_usual_pause_stays_if_the_drive_needs_nearly_all_of_it(shell):
    slow = virtual_drive("vlt3500", 5, baudrate=115200)
    slow.needs_pause_s = 0.009
    shell.line(slow, name="slow")
    assert shell("tune", "vlt3500:5", "--baudrate", "115200", "--exchanges", "20", port="slow") == 0
    assert "pause 10 ms stays: " in shell.out
    assert "was enough, which leaves no room for a margin" in shell.out


def test_tune_prints_json(shell):
    assert shell("tune", "vlt3500:5", "--baudrate", "115200", "--exchanges", "50", "--json") == 0
    forecast, found = shell.objects
    assert forecast["seconds"] > 1
    assert found["drive"] == "vlt3500:5"
    assert found["options"] == {"tuned_turnaround_s": 0.00142, "reply_timeout_s": 0.1}
    assert found["before"]["turnaround_s"] == 0.01
    assert found["after"]["exchanges"] == 50
    assert found["gain"] > 1.4
    assert found["error"] == ""
    assert found["reply_delays"]["longest_ms"] == 10.0
    assert shell.err == ""


@pytest.mark.soak
def test_write_puts_the_pause_into_the_plant_file(shell, plant):
    assert shell("tune", "pump", "--plant", str(plant), port=None) == 0
    assert "; --write adds them to the plant file\n" in shell.out
    assert plant.read_text() == PLANT
    assert shell("tune", "pump", "--plant", str(plant), "--write", port=None) == 0
    assert f"written to {plant}: tuned_turnaround_s = 0.00142, reply_timeout_s = 0.1\n" in shell.out
    new = "{ baudrate = 115200, tuned_turnaround_s = 0.00142, reply_timeout_s = 0.1 }"
    assert plant.read_text() == PLANT.replace("{ baudrate = 115200 }", new)
    assert read_plant(plant).drive("pump").options["tuned_turnaround_s"] == 0.00142
    assert shell("status", "pump", "--plant", str(plant), port=None) == 0
    written = plant.read_text()
    assert shell("tune", "pump", "--plant", str(plant), "--write", port=None) == 0
    assert "written" not in shell.out, "nothing has changed"
    assert plant.read_text() == written


def test_write_reports_the_plant_file_as_json(shell, plant):
    assert shell("tune", "pump", "--exchanges", "20", "--plant", str(plant), "--write", "--json", port=None) == 0
    _, found, written = shell.objects
    named = {"name": "pump", "drive": "vlt3500:5", "line": "hall", "drive_name": "pump"}
    assert written == {**named, "written": str(plant)}
    assert read_plant(plant).drive("pump").options.items() >= found["options"].items()


def test_write_finds_the_drive_by_its_address(shell, plant):
    assert shell("tune", "vlt3500:5", "--exchanges", "20", "--plant", str(plant), "--write", port=None) == 0
    assert "tuned_turnaround_s" in read_plant(plant).drive("pump").options


def test_write_needs_a_plant(shell, line):
    assert shell("tune", "vlt3500:5", "--write") == 2
    assert "vlt3500:5 is not in a plant file that --write could change; name one: --plant plant.toml" in shell.err
    assert line.time == 0, "said before anything is sent"


def test_line_with_errors_at_any_pause_changes_nothing(shell, plant, line):
    line.faults = FaultPlan(rate=0.2, kinds=[LineFault.CORRUPT], requests=False)
    assert shell("tune", "pump", "--plant", str(plant), "--write", port=None) == 1
    assert "pump  fails with its usual pause of 10 ms and with longer ones: " in shell.out
    assert shell.out.endswith("; see drivecomm doctor\n")
    assert plant.read_text() == PLANT


def test_drive_that_falls_silent_changes_nothing(shell, plant, line):
    line.call_at(3.5, lambda: line.power_off(line.drives[0]))
    assert shell("tune", "pump", "--plant", str(plant), "--write", port=None) == 4
    assert "pump  interrupted; the shortest pause that worked so far is " in shell.out
    assert "did not answer" in shell.err
    assert plant.read_text() == PLANT


@pytest.mark.parametrize("as_json", [False, True])
def test_ctrl_c_prints_the_pause_found_so_far_and_changes_nothing(shell, plant, line, as_json):
    telegrams = count()

    def interrupt(_sent):
        if next(telegrams) == 160:
            raise KeyboardInterrupt

    line.monitors.append(interrupt)
    assert shell("tune", "pump", "--plant", str(plant), "--write", *["--json"] * as_json, port=None) == 130
    assert "interrupted" in shell.err
    assert plant.read_text() == PLANT
    if as_json:
        found = [each["trial"]["turnaround_s"] for each in shell.objects if "trial" in each]
        assert found == [0.01, 0.005]
    else:
        assert shell.out == "pump  interrupted; the shortest pause that worked so far is 5 ms, nothing was changed\n"
    line.advance(1)
    assert shell("status", "pump", "--plant", str(plant), port=None) == 0


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--exchanges", "5"], "5 exchanges are too few; use 20 or more"),
        (["--attempts", "2"], "tune counts each request that fails, so --attempts has no effect; leave it out"),
        (["--arm"], "tune does not command a drive, so --arm has no effect; leave it out"),
    ],
)
def test_tune_refuses_useless_arguments(shell, arguments, sentence):
    assert shell("tune", "vlt3500:5", *arguments) == 2
    assert sentence in shell.err


def test_tune_has_help():
    assert main(["tune", "--help"]) == 0
