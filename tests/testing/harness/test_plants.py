"""Watched plants: lines and drives by name, in virtual and real time."""

import os
import threading

import pytest

import drivecomm
from drivecomm.errors import FileFormatError, UsageError
from drivecomm.plant import read_plant
from drivecomm.virtual import virtual_drive

PLANT = """
format = 1

[[line]]
name = "hall"
listen = "tcp:192.0.2.1:4001"

[[line]]
name = "yard"
echo = true
noise = { rate = 0.5, seed = 3, kinds = ["drop"] }

[[drive]]
name = "pump"
drive = "vabus:1"
line = "hall"
options = { model = "agile" }
values = { "480" = 1200 }

[[drive]]
name = "fan"
drive = "danfoss-fc:3"
line = "hall"

[[drive]]
name = "gate"
drive = "fuji:7"
line = "yard"

[[fault]]
drive = "pump"
trip = { code = 5, at_s = 100 }

[[fault]]
drive = "pump"
power = { off_at_s = 200, back_at_s = 210, factory = true }
"""


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "plant.toml"
    path.write_text(PLANT, encoding="utf-8")
    return path


def test_plant_file_runs_in_virtual_time(lines, path):
    plant = lines.plant(path)
    assert list(plant.lines) == ["hall", "yard"]
    assert list(plant.drives) == ["pump", "fan", "gate"]
    pump = plant.drive("pump")
    with drivecomm.open_bus(plant.line("hall").port) as bus:
        master = bus.drive("vabus", 1, model="agile")
        master.read("481")
        pump.assert_received(kind="enquiry", parameter=481, times=1)
        pump.assert_holds("480", 1200)
        plant.drive("fan").assert_nothing_received()
        plant.line("hall").advance(100)
        assert master.status().fault_code == 5
        # The factory reset has replaced the drive by a new one, which must be watched as well.
        plant.line("hall").advance(150)
        pump.forget_received()
        master.read("481")
        pump.assert_received(kind="enquiry", parameter=481)
        assert pump.holds("480") == virtual_drive("vabus", 1, model="agile").peek("480", 0.0) != "000004B0"
    assert "value address=1" in plant.line("hall").trace()
    plant.plant.trip("pump", 3)
    assert pump.motor.fault == 3


def test_plant_object_is_accepted_in_place_of_a_file(lines, path):
    plant = lines.plant(read_plant(path))
    assert plant.line("yard").drive("gate") is plant.drive("gate")


@pytest.mark.soak
@pytest.mark.parametrize("listen", ["tcp", "pty"])
def test_plant_is_served_in_real_time(lines, path, listen):
    if listen == "pty" and os.name != "posix":
        pytest.skip("this system has no pseudo-terminals")
    threads = threading.active_count()
    plant = lines.plant(path, listen=listen)
    assert threading.active_count() == threads + 1
    with drivecomm.open_bus(plant.line("hall").port) as bus:
        bus.drive("danfoss-fc", 3, model="fc300").write("3-41", 10)
    plant.drive("fan").assert_holds("3-41", 1000)
    plant.drive("pump").assert_nothing_received()
    plant.drive("pump").poke("481", 7)
    plant.drive("pump").assert_holds("481", 7)
    with drivecomm.open_bus(plant.line("yard").port, echo=True) as bus:
        bus.drive("fuji", 7, model="frenic", attempts=20).read("F07")
    plant.drive("gate").assert_received()
    with pytest.raises(UsageError, match="served in real time"):
        _ = plant.plant
    plant.close()
    assert threading.active_count() == threads


def test_trace_titles_name_the_lines(lines, path):
    lines.plant(path)
    titles = [title for title, _ in lines.traces()]
    assert titles == ["line hall: pump, fan, in virtual time", "line yard: gate, in virtual time"]
    assert dict(lines.traces())[titles[1]].startswith("faults: rate 0.5, seed 3; happened: none yet")


def test_invalid_names_and_files_of_a_plant_are_refused(lines, path):
    plant = lines.plant(path)
    with pytest.raises(UsageError, match="no line 'roof' in this plant; it has hall, yard"):
        plant.line("roof")
    with pytest.raises(UsageError, match="no drive 'crane' in this plant; it has pump, fan, gate"):
        plant.drive("crane")
    with pytest.raises(UsageError, match="served at pty, tcp or rfc2217, not at 'tcp:x:1'"):
        lines.plant(path, listen="tcp:x:1")
    path.write_text("format = 2", encoding="utf-8")
    with pytest.raises(FileFormatError):
        lines.plant(path)


def test_watched_drive_trips_on_a_silent_master(lines, tmp_path):
    path = tmp_path / "plant.toml"
    drive = 'name = "gate"\ndrive = "fuji:7"\nline = "yard"\noptions = { model = "frenic" }\n'
    drive += "values = { y08 = 4, y02 = 0 }\n"
    path.write_text(f'format = 1\n[[line]]\nname = "yard"\n[[drive]]\n{drive}', encoding="utf-8")
    plant = lines.plant(path)
    with drivecomm.open_bus(plant.line("yard").port) as bus:
        master = bus.drive("fuji", 7, model="frenic")
        master.set_reference(hz=20)
        master.start()
        plant.line("yard").advance(3)
        assert plant.plant.states()[0].running
        plant.line("yard").advance(3)
        assert plant.plant.states()[0].fault
