"""A virtual drive that ignores requests that begin too soon after its own reply."""

import pytest

import drivecomm
from drivecomm.errors import FileFormatError, NoReplyError
from drivecomm.line import Plan, PollItem
from drivecomm.plant import read_plant
from drivecomm.virtual import VirtualPlant, forecast

PLANT = """
format = 1
[[line]]
name = "hall"
[[drive]]
name = "pump"
drive = "vlt3500:5"
needs_pause_s = 0.003
[[drive]]
drive = "fuji:6"
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "plant.toml"
    path.write_text(PLANT)
    return path


@pytest.mark.parametrize(("pause_s", "heard"), [(0.0, False), (0.0029, False), (0.0031, True)])
def test_request_that_begins_too_soon_is_ignored(file, pause_s, heard):
    with drivecomm.open_bus(VirtualPlant(read_plant(file)).line("hall").port, turnaround_s=pause_s) as bus:
        pump, fan = bus.drive("vlt3500", 5), bus.drive("fuji", 6)
        pump.probe()
        fan.probe()
        pump.probe()
        if heard:
            pump.probe()
        else:
            with pytest.raises(NoReplyError):
                pump.probe()
            pump.probe()


def test_forecast_ignores_the_needed_pause(file):
    pump = read_plant(file).drive("pump")
    plan = Plan(reads=tuple(PollItem(drive=pump, parameter=each) for each in ("215", "216")))
    found = forecast(plan, turnaround_s=0.0)
    assert found.cycle_s < 0.2


def test_invalid_needed_pause_is_refused(file):
    file.write_text(PLANT.replace("0.003", "-1"))
    with pytest.raises(FileFormatError, match="invalid needs_pause_s = -1; write 0 to 60 seconds"):
        read_plant(file)
